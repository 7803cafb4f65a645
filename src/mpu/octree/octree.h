// The octree: cells, and the fits blended over their balls.
#pragma once
#include "mpu/fit/quadric.h"
#include "sorted_points.h"
#include <mpuvdb/mpu_field.h>

#include <array>
#include <cstdint>
#include <tbb/parallel_for.h>
#include <utility>
#include <vector>

namespace mpuvdb
{

struct NoisyScan;

/// A quadric in single precision about its fit's origin:
/// c0 + c1 x + c2 y + c3 z + c4 xx + c5 yy + c6 zz + c7 xy + c8 yz + c9 zx.
using QuadricCoefficients = std::array<float, 10>;

/// A local fit as stored; several cells may share one (empty cells inherit their parent's).
struct StoredFit {
    Vec3f origin; ///< local coordinates
    std::uint32_t firstQuadric = 0;
    std::uint8_t count = 1; ///< pieces, as in LocalFit
    std::uint8_t maxBits = 0;
    bool throughOrigin = false; ///< the origin is an input point, and the fit is zero there
    std::uint8_t unused = 0;    ///< so that equal fits have equal bytes in files
};

struct OctreeNode {
    static constexpr float kInner = -1; ///< support of inner nodes [derived: below that of leaves]
    std::uint32_t index = 0; ///< a leaf's fit; an inner node's first child, of eight in a row
    /// Support of the fit by data in the cell's ball, in [0,1]; kInner for an inner node.
    float support = kInner;

    bool isLeaf() const { return support >= 0; }
};

/// The geometry of an octree and of its fits' supports.
struct OctreeShape {
    /// Level of the smallest cells, a billionth of the root's edge: points left together in one
    /// count as one. [derived: cells' indices have 32 bits]
    static constexpr int kMaxLevel = 30;

    RootCube root;
    double alpha = 0.75;
    /// Largest distance of a ball's center from its cell's, in diagonals of the cell. Above 0 for
    /// interpolation: balls are centered at points, and weights singular.
    double offCenter = 0;

    OctreeShape() = default;
    OctreeShape(const RootCube& cube, const MpuSettings& settings)
        : root(cube), alpha(settings.alpha), offCenter(settings.interpolate ? 0.5 : 0)
    {
    }

    double supportRadius(int level) const { return alpha * std::sqrt(3.0) * root.size(level); }
    bool interpolates() const { return offCenter > 0; }
    /// Radius of a ball about a cell's center that holds the supports of the cell and its children.
    double reach(int level) const
    {
        return (alpha + offCenter) * std::sqrt(3.0) * root.size(level);
    }
    /// Whether the leaf @a cell holds the input point through which its @a fit goes.
    bool holdsItsPoint(const OctreeCell& cell, const StoredFit& fit) const
    {
        return fit.throughOrigin && root.holds(cell, fit.origin.cast<double>());
    }
    /// Center of the support of the leaf @a cell.
    Vec3d ballCenter(const OctreeCell& cell, const StoredFit& fit) const
    {
        return holdsItsPoint(cell, fit) ? Vec3d(fit.origin.cast<double>()) : root.center(cell);
    }
};

/// A tree, or a subtree, while it is built.
struct OctreeDraft : OctreeShape {
    std::vector<OctreeNode> nodes;
    std::vector<StoredFit> fits;
    std::vector<QuadricCoefficients> quadrics;
    MpuStatistics statistics;
    bool complete = true; ///< every leaf is fully supported

    OctreeDraft() = default;
    explicit OctreeDraft(const OctreeShape& shape) : OctreeShape(shape) {}

    void setLeaf(std::uint32_t node, std::uint32_t fit, double support);
    /// Store @a fit about @a origin (local coordinates); returns its index.
    std::uint32_t addFit(const LocalFit& fit, const Vec3d& origin);
    /// Store a fit about the input point @a point, at which it is zero; returns its index.
    std::uint32_t addFitThrough(const Vec3f& point, const Quadric& fit);
    /// As Octree::rulingAt().
    Quadric rulingAt(const StoredFit& fit, const Vec3d& y) const;
    /// Append @a subtree, whose node 0 becomes node @a at.
    void graft(std::uint32_t at, const OctreeDraft& subtree);
    /// Add the statistics of a part.
    void add(const MpuStatistics& part);
    /// Memory without room to grow, bytes.
    std::uint64_t usedBytes() const;

    /// Call f(node, cell) for every leaf below a node, depth first.
    template <typename F>
    void forEachLeaf(F f, std::uint32_t node = 0, const OctreeCell& cell = {})
    {
        forEachPart([&](std::uint32_t n, const OctreeCell& at) { f(nodes[n], at); }, kMaxLevel,
                    node, cell);
    }

    /// Call f(node, cell) for all leaves, in parallel.
    template <typename F>
    void forEachLeafParallel(F f)
    {
        constexpr int kParallelLevel = 4; ///< level with subtrees for all threads [free: grain]
        std::vector<std::pair<std::uint32_t, OctreeCell>> parts;
        const auto collect = [&](std::uint32_t node, const OctreeCell& cell) {
            parts.push_back({node, cell});
        };
        forEachPart(collect, kParallelLevel, 0, {});
        tbb::parallel_for(std::size_t(0), parts.size(),
                          [&](std::size_t n) { forEachLeaf(f, parts[n].first, parts[n].second); });
    }

private:
    /// Call f(index, cell) for the leaves above level @a deepest and the nodes of that level.
    template <typename F>
    void forEachPart(const F& f, int deepest, std::uint32_t node, const OctreeCell& cell)
    {
        if (nodes[node].isLeaf() || cell.level == deepest) {
            f(node, cell);
            return;
        }
        for (int octant = 0; octant < 8; ++octant)
            forEachPart(f, deepest, nodes[node].index + std::uint32_t(octant), cell.child(octant));
    }
};

/// Nodes of a tree, and its fits; in memory, or mapped.
struct Octree : OctreeShape {
    StoredArray<OctreeNode> nodes;
    StoredArray<StoredFit> fits;
    StoredArray<QuadricCoefficients> quadrics;
    MpuStatistics statistics;

    Octree() = default;
    explicit Octree(const OctreeShape& shape) : OctreeShape(shape) {}
    explicit Octree(OctreeDraft&& draft);

    /// The piece of a stored fit that is in effect at @a y from its origin; about the origin.
    Quadric rulingAt(const StoredFit& fit, const Vec3d& y) const;
    /// One piece of a stored fit about another origin, in double precision.
    Quadric pieceAbout(const StoredFit& fit, std::size_t piece, const Vec3d& origin) const;
    /// Memory held, bytes.
    std::uint64_t bytes() const;

    /// Call f(node, cell) for @a node if it is a leaf, else for the leaves below it whose balls
    /// hold @a p (local coordinates), and some close to it, depth first.
    template <typename F>
    void forEachLeafAt(const Vec3d& p, const F& f, OctreeNode node, const OctreeCell& cell) const
    {
        constexpr double kRoundingMargin = 1 + 1e-6; ///< factor [derived: roundings in small cells]
        if (node.isLeaf()) {
            f(node, cell);
            return;
        }
        const double quarter = root.size(cell.level) / 4,
                     radius = kRoundingMargin * reach(cell.level + 1);
        const Vec3d offset = root.center(cell) - p;
        double distance2[3][2]; // along each axis to the lower and the upper child
        for (int axis = 0; axis < 3; ++axis)
            for (int side = 0; side < 2; ++side)
                distance2[axis][side] = std::pow(offset[axis] + (side ? quarter : -quarter), 2);
        for (int octant = 0; octant < 8; ++octant)
            if (distance2[0][octant & 1] + distance2[1][octant >> 1 & 1] +
                    distance2[2][octant >> 2 & 1] <
                radius * radius)
                forEachLeafAt(p, f, nodes[node.index + std::uint32_t(octant)], cell.child(octant));
    }
};

/// A cell whose subtree is built apart from all others.
struct SubtreeRoot {
    OctreeCell cell;
    std::uint32_t node = 0; ///< its place in the upper tree
    double spacing = 0;     ///< of the points, as estimated for its parent, world units
};

/// The upper part of an octree, decided on samples of the points, and where its subtrees begin.
struct UpperOctree {
    OctreeDraft tree;
    std::vector<SubtreeRoot> subtrees;
};

/// @throws InputError without points or normals, UsageError for settings out of range.
void checkSettings(const PointCloud& cloud, const MpuSettings& settings);

/// A cube about the points with room for the band and the fits' balls.
RootCube rootCube(const Box3d& bounds, double voxelSize);

/// Decide the upper part of the octree of @a points [Ohtake03 §3]; the same for any number of
/// threads. @param scan  of noisy points, or null.
UpperOctree buildUpper(const SortedPoints& points, const RootCube& root,
                       const MpuSettings& settings, const NoisyScan* scan, Interrupter& progress);

/// Fit the subtrees from @a begin to before @a end, each apart from the others: the result does not
/// depend on what else is built.
std::vector<OctreeDraft> buildSubtrees(const SortedPoints& points, const RootCube& root,
                                       const MpuSettings& settings, const NoisyScan* scan,
                                       const SubtreeRoot* begin, const SubtreeRoot* end,
                                       Interrupter& progress);

/// The whole of both.
OctreeDraft buildOctree(const SortedPoints& points, const RootCube& root,
                        const MpuSettings& settings, Interrupter& progress);

} // namespace mpuvdb
