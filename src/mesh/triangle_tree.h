// A tree of boxes over the triangles of a mesh.
#pragma once
#include <mpuvdb/triangle_mesh.h>

#include <array>
#include <vector>

namespace mpuvdb
{

class Progress;

/// The triangles in the order of a space-filling curve, a few per leaf, under a complete binary
/// tree of boxes: node n has the children 2n and 2n+1, the root is 1. The same for any number of
/// threads.
class TriangleTree
{
public:
    using Corners = std::array<Vec3f, 3>; ///< relative to the mesh's frame
    using Box = Eigen::AlignedBox3f;

    /// @param mesh  has triangles; need not outlive this. @throws Interrupted.
    TriangleTree(const Mesh& mesh, Progress& progress);

    std::size_t size() const { return mOrder.size(); }
    /// Of the triangle at place @a slot, its index in the mesh and its corners.
    std::uint32_t triangle(std::size_t slot) const { return mOrder[slot]; }
    const Corners& corners(std::size_t slot) const { return mCorners[slot]; }

    std::size_t leaves() const { return mLeaves; }
    /// The first slot of a leaf; that of leaf leaves() is size().
    std::size_t firstSlot(std::size_t leaf) const { return leaf * size() / mLeaves; }
    const Box& leafBox(std::size_t leaf) const { return mBoxes[mLeaves + leaf]; }

    /// Squared distance from @a p, relative to the mesh's frame, to the nearest triangle.
    /// @param slot  where to look first; becomes the slot of the triangle found.
    double squaredDistance(const Vec3d& p, std::size_t& slot) const;

    /// Call f(leaf) for the leaves from @a first on whose boxes meet @a box.
    template <class F>
    void forEachLeaf(const Box& box, std::size_t first, const F& f) const
    {
        std::size_t stack[2 * kMostLevels];
        std::size_t height = 0;
        stack[height++] = 1;
        while (height > 0) {
            const std::size_t node = stack[--height];
            if (!mBoxes[node].intersects(box)) continue;
            if (node >= mLeaves) {
                if (node - mLeaves >= first) f(node - mLeaves);
                continue;
            }
            stack[height++] = 2 * node + 1;
            stack[height++] = 2 * node;
        }
    }

private:
    static constexpr std::size_t kMostLevels = 64;

    void sortTriangles(const Mesh& mesh);

    std::vector<std::uint32_t> mOrder;
    std::vector<Corners> mCorners;
    std::size_t mLeaves = 1; ///< a power of two
    std::vector<Box> mBoxes; ///< by node; the first is not used
};

} // namespace mpuvdb
