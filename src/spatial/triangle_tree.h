// A tree of boxes over the triangles of a mesh.
#pragma once
#include <mpuvdb/triangle_mesh.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// The triangles in the order of a space-filling curve, a few per leaf, under a complete binary
/// tree of boxes: node n has the children 2n and 2n+1, the root is 1. The same for any number of
/// threads.
class TriangleTree
{
public:
    using Corners = std::array<Vec3f, 3>; ///< relative to the mesh's frame
    using Box = Eigen::AlignedBox3f;
    /// Most triangles of a leaf. [free: the same distances]
    static constexpr std::size_t kLeafTriangles = 4;

    /// @param mesh  has triangles; need not outlive this. @throws Interrupted.
    TriangleTree(const Mesh& mesh, Interrupter& progress);

    /// Memory of the tree of so many @a triangles, and at most while it is made, bytes.
    static std::uint64_t bytesFor(std::uint64_t triangles);

    std::size_t size() const { return mOrder.size(); }
    /// Of the triangle at place @a slot, its index in the mesh and its corners.
    std::uint32_t triangle(std::size_t slot) const { return mOrder[slot]; }
    const Corners& corners(std::size_t slot) const { return mCorners[slot]; }

    /// Of all triangles.
    const Box& box() const { return mBoxes[1]; }

    std::size_t leaves() const { return mLeaves; }
    /// Of nodes below the root.
    std::size_t levels() const { return std::size_t(__builtin_ctzll(mLeaves)); }
    /// The first slot of a leaf; that of leaf leaves() is size().
    std::size_t firstSlot(std::size_t leaf) const { return leaf * size() / mLeaves; }
    const Box& leafBox(std::size_t leaf) const { return mBoxes[mLeaves + leaf]; }

    /// Squared distance from @a p, relative to the mesh's frame, to the triangle at @a slot.
    double squaredDistanceTo(std::size_t slot, const Vec3d& p) const;
    /// The same to the nearest triangle, the one of the least slot where several are equally near.
    /// @param slot  where to look first; becomes the slot of the triangle found.
    double squaredDistance(const Vec3d& p, std::size_t& slot) const;
    /// The same, where some triangle is known to be nearer than @a below, squared, which saves
    /// time. @param slot  becomes that of the triangle found.
    double squaredDistance(const Vec3d& p, double below, std::size_t& slot) const;

    /// Whether a triangle is at most @a distance from @a p, relative to the mesh's frame.
    /// @param slot  where to look first; becomes the slot of the triangle found, if there is one.
    bool isWithin(const Vec3d& p, double distance, std::size_t& slot) const;

    /// Where the ray origin + t * @a direction, t >= 0, first meets a triangle, from either side;
    /// without gaps between neighbors. @param origin  relative to the mesh's frame.
    /// @param slot  becomes that of the triangle. @return t, infinite if there is none.
    double firstHit(const Vec3d& origin, const Vec3d& direction, std::size_t& slot) const;

    /// Call f(slot) for all triangles that are at most @a distance from @a p, and for some that are
    /// a little farther.
    template <class F>
    void forEachNear(const Vec3d& p, double distance, const F& f) const
    {
        forEachLeafNear(p, distance, [&](std::size_t leaf) {
            for (std::size_t s = firstSlot(leaf); s < firstSlot(leaf + 1); ++s) f(s);
        });
    }
    /// Call f(leaf) for all leaves whose boxes are at most @a distance from @a p.
    template <class F>
    void forEachLeafNear(const Vec3d& p, double distance, const F& f, std::size_t node = 1) const
    {
        if (mBoxes[node].cast<double>().squaredExteriorDistance(p) > distance * distance) return;
        if (node >= mLeaves) {
            f(node - mLeaves);
            return;
        }
        forEachLeafNear(p, distance, f, 2 * node);
        forEachLeafNear(p, distance, f, 2 * node + 1);
    }
    /// A lower bound of the squared distance from @a p to the triangles of a leaf.
    double squaredBoundOfLeaf(std::size_t leaf, const Vec3d& p) const
    {
        return squaredBound(mLeaves + leaf, p);
    }

    /// Call f(slot) for all triangles that the segment from @a a to @a b meets, and for some that
    /// it passes.
    template <class F>
    void forEachAlong(const Vec3d& a, const Vec3d& b, const F& f) const
    {
        const Vec3d middle = (a + b) / 2, half = (b - a) / 2;
        std::size_t stack[2 * kMostLevels];
        std::size_t height = 0;
        stack[height++] = 1;
        while (height > 0) {
            const std::size_t node = stack[--height];
            if (!meets(mBoxes[node], middle, half)) continue;
            if (node < mLeaves) {
                stack[height++] = 2 * node;
                stack[height++] = 2 * node + 1;
                continue;
            }
            for (std::size_t s = firstSlot(node - mLeaves); s < firstSlot(node - mLeaves + 1); ++s)
                f(s);
        }
    }

    /// Call f(a, b) for the pairs of nodes a <= b of one level whose boxes meet, and for each node
    /// with itself. @param levels  below the root, at most levels(). @param apart  world units:
    /// boxes meet that are no farther from each other.
    template <class F>
    void forEachPair(std::size_t levels, const F& f, float apart = 0) const
    {
        descend(1, 1, std::size_t(1) << levels, f, apart);
    }
    /// The same for the pairs of leaves below two nodes of one level: f takes leaves.
    template <class F>
    void forEachLeafPair(std::size_t a, std::size_t b, const F& f, float apart = 0) const
    {
        descend(
            a, b, mLeaves, [&](std::size_t c, std::size_t d) { f(c - mLeaves, d - mLeaves); },
            apart);
    }

private:
    static constexpr std::size_t kMostLevels = 64; ///< [derived: of a tree of halves of 2^64]

    /// @param first  node of the level to stop at.
    template <class F>
    void descend(std::size_t a, std::size_t b, std::size_t first, const F& f, float apart) const
    {
        if (a != b && !meet(mBoxes[a], mBoxes[b], apart)) return;
        if (a >= first) {
            f(a, b);
            return;
        }
        descend(2 * a, 2 * b, first, f, apart);
        descend(2 * a, 2 * b + 1, first, f, apart);
        if (a != b) descend(2 * a + 1, 2 * b, first, f, apart);
        descend(2 * a + 1, 2 * b + 1, first, f, apart);
    }

    /// Whether no axis, nor a product of one with the segment, separates a box from the segment
    /// middle +- half.
    static bool meets(const Box& box, const Vec3d& middle, const Vec3d& half)
    {
        constexpr double kRoundings = 1e-12; ///< relative [derived: thousands of roundings]
        const Vec3d low = box.min().cast<double>(), high = box.max().cast<double>();
        const Vec3d to = (low + high) / 2 - middle, along = half.cwiseAbs();
        const Vec3d sizes = (high - low) / 2 + kRoundings * (to.cwiseAbs() + along);
        if ((to.cwiseAbs().array() > (sizes + along).array()).any()) return false;
        for (int k = 0; k < 3; ++k) {
            const int u = (k + 1) % 3, v = (k + 2) % 3;
            if (std::abs(half[u] * to[v] - half[v] * to[u]) >
                sizes[u] * along[v] + sizes[v] * along[u])
                return false;
        }
        return true;
    }

    static bool meet(const Box& a, const Box& b, float apart)
    {
        return (a.min().array() <= b.max().array() + apart).all() &&
               (b.min().array() <= a.max().array() + apart).all();
    }

    /// A cylinder about the middle of a node's box that holds its triangles: where these are
    /// nearly in a plane, a much better bound than the box.
    struct Cylinder {
        Vec3f axis = Vec3f::Zero(); ///< unit, the triangles' mean normal; zero if there is none
        float radius = 0;
        float low = 0, high = 0; ///< along the axis, from the middle

        /// A lower bound of the squared distance from @a p to what is in it. @param p  from the
        /// middle.
        double squaredDistance(const Vec3d& p) const
        {
            /// Factor for an axis that is a unit vector but for roundings. [derived: of floats]
            constexpr double kRoundings = 1 - 0x1p-19;
            const double along = axis.cast<double>().dot(p);
            const double above = std::max({0.0, double(low) - along, along - double(high)});
            const double across = std::sqrt(std::max(p.squaredNorm() - along * along, 0.0));
            const double beside = std::max(0.0, across - double(radius));
            return (above * above + beside * beside) * kRoundings;
        }
    };

    double search(const Vec3d& p, double best, std::size_t& slot) const;
    void sortTriangles(const Mesh& mesh);
    void boundNodes(Interrupter& progress);
    Cylinder cylinderOf(std::size_t node) const;
    /// The slots below a node.
    std::pair<std::size_t, std::size_t> slotsBelow(std::size_t node) const;
    /// A lower bound of the squared distance from @a p to the triangles below a node.
    double squaredBound(std::size_t node, const Vec3d& p) const
    {
        const Vec3d lower = mBoxes[node].min().cast<double>() - p;
        const Vec3d upper = p - mBoxes[node].max().cast<double>();
        /// Factor for squares of triangles' distances that roundings make too small. [derived: of
        /// doubles, where a thousandth is left of what is subtracted]
        constexpr double kRoundings = 1 - 0x1p-40;
        const double box = kRoundings * lower.cwiseMax(upper).cwiseMax(0).squaredNorm();
        if (node < mFirstCylinder) return box;
        return std::max(box, mCylinders[node - mFirstCylinder].squaredDistance(p - middle(node)));
    }
    Vec3d middle(std::size_t node) const
    {
        return 0.5 * (mBoxes[node].min().cast<double>() + mBoxes[node].max().cast<double>());
    }

    std::vector<std::uint32_t> mOrder;
    std::vector<Corners> mCorners;
    std::size_t mLeaves = 1; ///< a power of two
    std::vector<Box> mBoxes; ///< by node; the first is not used
    std::size_t mFirstCylinder = 1;
    std::vector<Cylinder> mCylinders; ///< of the nodes from mFirstCylinder on
};

} // namespace mpuvdb
