// A bounding volume hierarchy of boxes and slabs over places on a surface, for searches of balls
// that touch it.
#pragma once
#include <mpuvdb/vec.h>

#include <cstdint>
#include <limits>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// Places on a surface, voxels.
struct Places {
    std::vector<Vec3f> positions, normals;

    std::size_t size() const { return positions.size(); }
};

class PlaceTree
{
public:
    /// Order of nodes that are not searched. [derived: infinity]
    static constexpr float kNever = std::numeric_limits<float>::infinity();
    /// The number of no place. [derived: the type's largest]
    static constexpr std::uint32_t kNone = ~std::uint32_t(0);

    /// Bounds of a run of places: a box, and a slab across the mean normal, which excludes a ball
    /// that touches much of a surface long before a box does.
    struct Node {
        Vec3f middle, half;       ///< of the box
        Vec3f axis;               ///< mean normal
        float low, high;          ///< range of the places along it
        std::uint32_t begin, end; ///< in the tree's order
        std::uint32_t second = 0; ///< second child, 0 for a leaf; the first is the next node

        /// Lower bound of the squared distance from @a p to the places; kNever if none is within
        /// @a reach.
        float squaredDistance(const Vec3f& p, float reach) const
        {
            const float along = axis.dot(p);
            if (low - along >= reach || along - high >= reach) return kNever;
            const float squared = squaredBoxDistance(p);
            return squared < reach * reach ? squared : kNever;
        }
        float squaredBoxDistance(const Vec3f& p) const
        {
            return ((p - middle).cwiseAbs() - half).cwiseMax(0.0f).squaredNorm();
        }
        /// Upper bound of the places' coordinates along @a direction.
        float farthest(const Vec3f& direction) const
        {
            return direction.dot(middle) + direction.cwiseAbs().dot(half);
        }
    };

    /// Sorts @a places into the tree's order. They have to outlive it. @throws Interrupted.
    PlaceTree(Places& places, const Interrupter& progress);

    /// Of each place in the tree's order, its number before.
    const std::vector<std::uint32_t>& order() const { return mOrder; }

    /// The nearest of @a places, the tree's, to @a p; kNone if all are at least as far as @a
    /// distance, which becomes its distance.
    std::uint32_t nearest(const Places& places, const Vec3f& p, float& distance) const;

    /// Call atPlace(n) for the places of all leaves with order(node) < kNever, lower orders first.
    /// A call may raise the order of nodes to come.
    template <typename Order, typename AtPlace>
    void search(Order order, AtPlace atPlace) const
    {
        if (!mNodes.empty()) searchBelow(0, order, atPlace);
    }

private:
    void build(const Places& places, std::uint32_t begin, std::uint32_t end, std::uint32_t at,
               const Interrupter& progress);

    template <typename Order, typename AtPlace>
    void searchBelow(std::uint32_t at, Order& order, AtPlace& atPlace) const
    {
        const Node& node = mNodes[at];
        if (node.second == 0) {
            for (std::uint32_t n = node.begin; n < node.end; ++n) atPlace(n);
            return;
        }
        std::uint32_t sooner = at + 1, later = node.second;
        float soon = order(mNodes[sooner]), late = order(mNodes[later]);
        if (late < soon) {
            std::swap(sooner, later);
            std::swap(soon, late);
        }
        if (soon < kNever) searchBelow(sooner, order, atPlace);
        if (late < kNever && order(mNodes[later]) < kNever) searchBelow(later, order, atPlace);
    }

    std::vector<std::uint32_t> mOrder;
    std::vector<Node> mNodes;
};

} // namespace mpuvdb
