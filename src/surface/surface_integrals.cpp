#include "surface_integrals.h"

#include "core/union_find.h"
#include "surface_cells.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <tbb/parallel_for.h>
#include <unordered_map>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using Leaf = LeafWindow::Leaf;

/// Edge of a leaf and the first layer beyond, voxels, and number of possible vertices: one for each
/// voxel and axis. [derived: kBlockDim]
constexpr int kExtent = kBlockDim + 1;
constexpr int kVertices = kExtent * kExtent * kExtent * 3;

/// Index of a vertex by the voxel that its edge starts at, and its axis.
std::uint32_t vertexIndex(const Vec3i& from, int axis)
{
    return std::uint32_t(((from[0] * kExtent + from[1]) * kExtent + from[2]) * 3 + axis);
}

/// A vertex on the border between leaves, and its component of its leaf's surface.
struct BorderVertex {
    std::uint32_t vertex; ///< in the leaf that its edge starts in
    std::uint32_t piece;
};

/// The surface in the cells that start in one leaf.
struct LeafSurface {
    double volume = 0, area = 0;
    Box3d bounds; ///< voxels, relative to the leaf
    std::int64_t vertices = 0, triangles = 0;
    std::uint64_t crossings = 0; ///< vertices on edges
    std::uint32_t pieces = 0;
    std::vector<BorderVertex> own; ///< on edges from the leaf's first layers, by vertex
    std::array<std::vector<BorderVertex>, 8> beyond; ///< by the leaf above: bits x, y, z
};

/// Integrates over one leaf after another.
class LeafIntegrator
{
public:
    explicit LeafIntegrator(const LevelSet& levelSet)
        : mWindow(levelSet.grid().tree(), levelSet.voxelSize(), levelSet.halfWidth()),
          mAccess(levelSet.grid().tree()), mFaces(mAccess, float(levelSet.voxelSize()))
    {
    }
    LeafIntegrator(const LeafIntegrator&) = delete;

    /// @param origin  of the leaf relative to the apex of volumes, voxels.
    LeafSurface integrate(const Leaf& leaf, const Vec3d& origin)
    {
        mWindow.load(leaf);
        mCrossed.clear();
        for (int x = 0; x < kBlockDim; ++x)
            for (int y = 0; y < kBlockDim; ++y)
                for (int z = 0; z < kBlockDim; ++z)
                    if (isCrossed(mWindow, {x, y, z})) mCrossed.emplace_back(x, y, z);
        LeafSurface sums;
        if (mCrossed.empty()) return sums;
        UnionFind vertices(kVertices);
        mSeen.clear();
        for (const Vec3i& base : mCrossed)
            addCell(base, leaf.origin().offsetBy(base[0], base[1], base[2]), origin, vertices,
                    sums);
        addVertices(vertices, mSeen, sums);
        return sums;
    }

private:
    void addCell(const Vec3i& base, const Coord& at, const Vec3d& origin, UnionFind& vertices,
                 LeafSurface& sums)
    {
        const CellQuadric quadric(mWindow, base);
        const CellFans triangles(mWindow, base, mFaces, at);
        sums.vertices += triangles.sheets();
        for (const SurfaceTriangle& t : triangles) {
            ++sums.triangles;
            mSeen.push_back(t.from); // each ends one segment and begins another
            vertices.join(vertexIndex(t.from.from, t.from.axis), vertexIndex(t.to.from, t.to.axis));
            const Vec3d &a = t.middle, &b = t.from.position, &c = t.to.position;
            const Vec3d normal = 0.5 * (b - a).cross(c - a); // as long as the area
            sums.volume += normal.dot(origin + (a + b + c) / 3) / 3;
            if (quadric.smooth)
                addCurved(quadric, {a, b, c}, normal, sums);
            else
                sums.area += normal.norm();
        }
    }

    /// The projection along the gradient from a triangle to the surface, a distance f away, scales
    /// areas by 1 - f trace(bend), to first order.
    static void addCurved(const CellQuadric& quadric, const std::array<Vec3d, 3>& corners,
                          const Vec3d& normal, LeafSurface& sums)
    {
        const Vec3d middle = (corners[0] + corners[1] + corners[2]) / 6;
        const double trace = quadric.bend.trace();
        for (const Vec3d& corner : corners) { // exact for second order
            const Vec3d at = middle + corner / 2;
            const Vec3d gradient = quadric.gradientAt(at);
            const double slope = gradient.norm(), f = quadric.valueAt(at) / slope;
            const double share = normal.dot(gradient) / slope / 3;
            sums.volume -= f * share * (1 - 0.5 * f * trace);
            sums.area += share * (1 - f * trace);
        }
    }

    static void addVertices(UnionFind& joined, std::vector<SurfaceVertex>& seen, LeafSurface& sums)
    {
        const auto index = [](const SurfaceVertex& v) { return vertexIndex(v.from, v.axis); };
        std::sort(seen.begin(), seen.end(),
                  [&](const auto& a, const auto& b) { return index(a) < index(b); });
        const auto same = [&](const auto& a, const auto& b) { return index(a) == index(b); };
        seen.erase(std::unique(seen.begin(), seen.end(), same), seen.end());
        std::unordered_map<std::uint32_t, std::uint32_t> pieces; // by root
        for (const SurfaceVertex& v : seen) {
            const std::uint32_t root = joined.find(index(v));
            const std::uint32_t piece =
                pieces.emplace(root, std::uint32_t(pieces.size())).first->second;
            sums.bounds.extend(v.position);
            int side = 0;
            Vec3i from = v.from;
            for (int axis = 0; axis < 3; ++axis)
                if (from[axis] == kBlockDim) {
                    from[axis] = 0;
                    side |= 1 << axis;
                }
            if (side) {
                sums.beyond[std::size_t(side)].push_back({vertexIndex(from, v.axis), piece});
                continue;
            }
            ++sums.vertices;
            ++sums.crossings;
            if (from.minCoeff() == 0) sums.own.push_back({index(v), piece});
        }
        sums.pieces = std::uint32_t(pieces.size());
    }

    LeafWindow mWindow;
    JoinedFaces::Access mAccess;
    JoinedFaces mFaces;
    std::vector<Vec3i> mCrossed;
    std::vector<SurfaceVertex> mSeen;
};

/// The number of connected surfaces; pieces that share vertices are one.
std::uint64_t countSurfaces(const std::vector<const Leaf*>& leaves,
                            const std::vector<LeafSurface>& surfaces, Interrupter& progress)
{
    std::unordered_map<Coord, std::size_t> at;
    std::vector<std::uint32_t> first(leaves.size() + 1, 0);
    for (std::size_t n = 0; n < leaves.size(); ++n) {
        at.emplace(leaves[n]->origin(), n);
        first[n + 1] = first[n] + surfaces[n].pieces;
    }
    UnionFind pieces(first.back());
    std::uint64_t count = first.back();
    for (std::size_t n = 0; n < leaves.size(); ++n) {
        if (n % 1024 == 0) progress.check();
        for (int side = 1; side < 8; ++side) {
            const std::vector<BorderVertex>& beyond = surfaces[n].beyond[std::size_t(side)];
            if (beyond.empty()) continue;
            const auto next = at.find(leaves[n]->origin().offsetBy(
                kBlockDim * (side & 1), kBlockDim * (side >> 1 & 1), kBlockDim * (side >> 2)));
            if (next == at.end()) continue;
            const std::size_t m = next->second;
            const std::vector<BorderVertex>& own = surfaces[m].own;
            for (const BorderVertex& v : beyond) {
                const auto twin =
                    std::lower_bound(own.begin(), own.end(), v, [](const auto& a, const auto& b) {
                        return a.vertex < b.vertex;
                    });
                if (twin != own.end() && twin->vertex == v.vertex)
                    count -= pieces.join(first[n] + v.piece, first[m] + twin->piece);
            }
        }
    }
    return count;
}

} // namespace

SurfaceIntegrals integrateSurface(const LevelSet& levelSet, Interrupter& progress)
{
    SurfaceIntegrals sums;
    std::vector<const Leaf*> leaves;
    levelSet.grid().tree().getNodes(leaves);
    if (leaves.empty()) return sums;
    const Coord home = leaves[0]->origin();
    const auto fromHome = [&](const Leaf& leaf) {
        const Coord o = leaf.origin() - home;
        return Vec3d(o[0], o[1], o[2]);
    };
    std::vector<LeafSurface> surfaces(leaves.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, leaves.size(), 16),
                      [&](const tbb::blocked_range<std::size_t>& range) {
                          LeafIntegrator integrator(levelSet);
                          for (std::size_t n = range.begin(); n < range.end(); ++n) {
                              progress.check();
                              surfaces[n] = integrator.integrate(*leaves[n], fromHome(*leaves[n]));
                          }
                      });
    const Lattice lattice = levelSet.lattice();
    const double h = lattice.voxelSize;
    const Vec3d frame = lattice.origin + h * Vec3d(home[0], home[1], home[2]);
    std::int64_t vertices = 0, triangles = 0;
    for (std::size_t n = 0; n < leaves.size(); ++n) {
        const LeafSurface& s = surfaces[n];
        sums.volume += s.volume * h * h * h;
        sums.area += s.area * h * h;
        vertices += s.vertices;
        triangles += s.triangles;
        sums.crossings += s.crossings;
        if (s.bounds.isEmpty()) continue;
        const Vec3d at = fromHome(*leaves[n]);
        sums.bounds.extend(
            Box3d(frame + h * (at + s.bounds.min()), frame + h * (at + s.bounds.max())));
    }
    // Each edge of the closed surface belongs to two triangles.
    sums.eulerCharacteristic = vertices - triangles / 2;
    sums.surfaces = countSurfaces(leaves, surfaces, progress);
    return sums;
}

} // namespace mpuvdb
