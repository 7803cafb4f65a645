// The points of a cloud in Morton order under a tree of boxes: what is near a place is found by it.
#pragma once
#include "bucket_tree.h"

#include <mpuvdb/vec.h>

#include <cstdint>
#include <memory>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// Positions sorted by the Morton order of a cube about them. Equal positions are one run, by their
/// indices in the caller's array. Immutable; it depends neither on the number of threads nor, but
/// for those indices, on the caller's order.
class PointIndex
{
public:
    /// A point found: its place in the index, and its squared distance.
    struct Near {
        double squared;
        std::uint32_t place;
    };

    /// @throws Interrupted.
    PointIndex(const std::vector<Vec3f>& positions, Interrupter& progress);

    std::size_t size() const { return mOrder.size(); }
    Coordinates positions() const { return {mX.data(), mY.data(), mZ.data()}; }
    Vec3f operator[](std::size_t place) const { return {mX[place], mY[place], mZ[place]}; }
    /// The caller's index of the point at each place.
    const std::vector<std::uint32_t>& order() const { return mOrder; }
    /// Whether the position at @a place is that of the place before it.
    bool isCopy(std::size_t place) const
    {
        return place > 0 && (*this)[place] == (*this)[place - 1];
    }
    /// The end of the run of equal positions that begins at @a place.
    std::size_t endOfCopies(std::size_t place) const
    {
        std::size_t end = place + 1;
        while (end < size() && isCopy(end)) ++end;
        return end;
    }
    /// The box of all positions.
    Eigen::AlignedBox3f bounds() const
    {
        return size() == 0 ? Eigen::AlignedBox3f() : mTree.nodes()[0].box;
    }
    /// Whether it is the index of @a positions.
    bool isOf(const std::vector<Vec3f>& positions, Interrupter& progress) const;

    /// Be the index of the caller's array in the index's own order().
    void followOrder();

    /// Without the points i of the caller's array whose keep[i] is 0; the others have the indices
    /// that they had.
    std::shared_ptr<const PointIndex> kept(const std::vector<std::uint8_t>& keep,
                                           Interrupter& progress) const;
    /// The index of the caller's array once the points @a indices are taken out of it.
    std::shared_ptr<const PointIndex> without(const std::vector<std::uint32_t>& indices,
                                              Interrupter& progress) const;

    /// One point for each position: those of the caller's array @a placeOf of whose index is in it.
    std::shared_ptr<const PointIndex> distinct(std::vector<std::uint32_t>& placeOf,
                                               Interrupter& progress) const;

    /// Fill @a found with the @a count distinct positions nearest to @a center, one place for each,
    /// the first of its copies; by distance, and by x, y, z where distances are equal. There
    /// are fewer only where the index has no more.
    void nearest(const Vec3f& center, std::size_t count, std::vector<Near>& found) const;

    /// Call f(begin, end) for runs of places, in order, that together hold all points no farther
    /// than @a radius from @a center, and others near them.
    template <class F>
    void forEachRunNear(const Vec3f& center, double radius, F&& f) const
    {
        if (size() > 0) visitBall(0, center, radius * radius, f);
    }

private:
    PointIndex() = default;
    void makeTree();

    double squaredDistance(std::size_t place, const Vec3f& to) const
    {
        return ((*this)[place].cast<double>() - to.cast<double>()).squaredNorm();
    }
    /// No more than that of any point of a node.
    double squaredDistanceOfNode(std::uint32_t node, const Vec3f& to) const
    {
        const Eigen::AlignedBox3f& box = mTree.nodes()[node].box;
        const Vec3d p = to.cast<double>();
        return (box.min().cast<double>() - p)
            .cwiseMax(p - box.max().cast<double>())
            .cwiseMax(0)
            .squaredNorm();
    }
    template <class F>
    void visitBall(std::uint32_t at, const Vec3f& center, double squared, F& f) const
    {
        if (squaredDistanceOfNode(at, center) > squared) return;
        const BucketTree::Node& node = mTree.nodes()[at];
        if (!node.leaf) {
            visitBall(at + 1, center, squared, f);
            visitBall(node.second, center, squared, f);
            return;
        }
        const BucketTree::Bucket& bucket = mTree.bucketOf(at);
        f(bucket.begin, bucket.end);
    }

    std::vector<std::uint32_t> mOrder;
    std::vector<float> mX, mY, mZ;
    BucketTree mTree;
};

} // namespace mpuvdb
