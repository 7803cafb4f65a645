// Points in Morton order, one array per coordinate, and ball queries on them.
#pragma once
#include "core/stored_array.h"
#include "spatial/bucket_tree.h"
#include "spatial/point_batch.h"

#include <mpuvdb/point_cloud.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace mpuvdb
{

class ArrayFile;
class ArrayFileWriter;
class Interrupter;

/// A cube of the octree, by its integer position at its level.
struct OctreeCell {
    int level = 0;
    std::uint32_t i = 0, j = 0, k = 0;

    OctreeCell child(int octant) const
    {
        return {level + 1, 2 * i + std::uint32_t(octant & 1),
                2 * j + std::uint32_t(octant >> 1 & 1), 2 * k + std::uint32_t(octant >> 2 & 1)};
    }
};

/// The root cube of the octree, local coordinates.
struct RootCube {
    Vec3d corner = Vec3d::Zero();
    double side = 1;

    Box3d box() const { return {corner, corner + Vec3d::Constant(side)}; }
    double size(int level) const { return side / double(std::uint64_t(1) << level); }
    /// The cell of @a level that holds @a p, or the nearest one.
    OctreeCell cellAt(const Vec3d& p, int level) const
    {
        const Vec3d at = (p - corner) / size(level);
        const double last = double((std::uint64_t(1) << level) - 1);
        const auto q = at.cwiseMax(0).cwiseMin(last).cast<std::uint32_t>();
        return {level, q[0], q[1], q[2]};
    }
    Vec3d center(const OctreeCell& cell) const
    {
        const double s = size(cell.level);
        return corner + s * Vec3d(cell.i + 0.5, cell.j + 0.5, cell.k + 0.5);
    }
    /// Whether @a p is in the half-open cube: every point of the root is in exactly one cell of
    /// each level, as neighbors compute the same borders.
    bool holds(const OctreeCell& cell, const Vec3d& p) const
    {
        const double s = size(cell.level);
        const Vec3d low = corner + s * Vec3d(cell.i, cell.j, cell.k),
                    high = corner + s * Vec3d(cell.i + 1.0, cell.j + 1.0, cell.k + 1.0);
        return (low.array() <= p.array()).all() && (p.array() < high.array()).all();
    }
};

/// Immutable points; their order depends on their values, not on their order in the input.
class SortedPoints
{
public:
    /// Levels of a Morton key. [derived: 64 bits for three axes]
    static constexpr int kMaxLevel = 21;

    /// Treatment of points at one position.
    enum class Copies {
        Keep,
        Merge ///< into one, with the mean of all values
    };

    /// Consume positions, normals, confidences, colors and scalars of @a cloud.
    SortedPoints(PointCloud&& cloud, const RootCube& root, Interrupter& progress,
                 Copies copies = Copies::Keep);
    /// Points that are in the order of their @a keys, those of cells of an octree.
    SortedPoints(PointBatch&& points, std::vector<std::uint64_t>&& keys, const RootCube& root);
    /// The points that save() wrote to @a file under @a prefix, mapped. @throws InputError.
    SortedPoints(const ArrayFile& file, const std::string& prefix, const RootCube& root);
    /// Write all but the root cube to @a file; names begin with @a prefix. @throws IoError.
    void save(ArrayFileWriter& file, const std::string& prefix) const&;
    /// The same, and let go of each array once it is written.
    void save(ArrayFileWriter& file, const std::string& prefix) &&;

    std::size_t size() const { return mPoints.size(); }
    const PointArrays& points() const { return mPoints; }
    /// Morton key of the cell of kMaxLevel that holds point @a n.
    std::uint64_t keyOf(std::size_t n) const { return mKeys[n]; }
    /// One array each for linear red, green and blue, if there are colors, and for the scalars.
    const std::vector<StoredArray<float>>& channels() const { return mChannels; }
    bool hasColors() const { return mChannels.size() > mScalarNames.size(); }
    const std::vector<std::string>& scalarNames() const { return mScalarNames; }
    /// Memory held, bytes; mapped points take none.
    std::size_t bytes() const;

    struct Range {
        std::size_t begin, end;
    };
    /// The points of the cubes that cover a ball.
    struct Around {
        OctreeCell cell; ///< about whose center the ball is
        double radius;
        std::array<Range, 27> ranges{};
        std::size_t count = 0;  ///< number of ranges
        std::size_t points = 0; ///< in all ranges: an upper bound for the ball
    };
    /// The points around the ball of @a radius about the center of @a cell.
    Around around(const OctreeCell& cell, double radius) const;
    /// Copy to @a out the points in the ball among every @a stride th of those around it; of large
    /// strides the nearest multiple of kThinning below. @return the stride that was taken.
    std::size_t gather(const Around& around, std::size_t stride, BatchFilter& filter,
                       PointBatch& out) const;
    /// Number of points in @a box (local coordinates); at least @a limit if there are that many.
    std::size_t countIn(const Box3d& box, std::size_t limit, const OctreeCell& cell = {}) const;
    /// Call f(begin, end) for every occupied cell of @a level, in Morton order, whose first point
    /// is in @a among.
    template <typename F>
    void forEachCell(int level, const Range& among, F f) const
    {
        const auto cellOf = [&](std::size_t n) { return mKeys[n] >> 3 * (kMaxLevel - level); };
        std::size_t begin = among.begin;
        while (begin > 0 && begin < among.end && cellOf(begin) == cellOf(begin - 1)) ++begin;
        for (std::size_t end = begin; begin < among.end; begin = end) {
            while (end < mKeys.size() && cellOf(end) == cellOf(begin)) ++end;
            f(begin, end);
        }
    }
    template <typename F>
    void forEachCell(int level, F f) const
    {
        forEachCell(level, {0, size()}, f);
    }

    /// Ranges of points, in order and apart, that hold those in @a box (local coordinates) and
    /// perhaps some close to it.
    std::vector<Range> rangesIn(const Box3d& box) const;

    /// The finest level whose occupied cells hold @a count points or more on average.
    int levelOfCells(double count) const;

    Coordinates positions() const { return {mPoints.x, mPoints.y, mPoints.z}; }
    /// A tree over the largest cells of at most @a most points each (more only where they coincide)
    /// that together hold all points.
    BucketTree tree(std::size_t most) const
    {
        std::vector<BucketTree::Bucket> buckets;
        addBuckets(0, 0, mKeys.size(), most, buckets);
        return {positions(), std::move(buckets)};
    }

    /// The points in @a cell.
    Range cellRange(const OctreeCell& cell) const;

private:
    using Floats = std::array<StoredArray<float>, 7>;
    /// Stride of the points that are kept beside all. [free: time; below it, strides span few
    /// pages]
    static constexpr std::size_t kThinning = 1024;
    /// Points of a cell up to which they are counted one by one. [free: time]
    static constexpr std::size_t kMaxScanPoints = 32;

    void addRanges(const Box3d& box, const OctreeCell& cell, std::vector<Range>& ranges) const;
    void hold(PointBatch&& points, std::vector<std::uint64_t>&& keys);
    void hold(const Floats& floats, const Floats& thinned);
    void addBuckets(int level, std::size_t begin, std::size_t end, std::size_t most,
                    std::vector<BucketTree::Bucket>& buckets) const
    {
        if (end - begin <= most || level == kMaxLevel) {
            if (begin < end) buckets.push_back({std::uint32_t(begin), std::uint32_t(end)});
            return;
        }
        const int below = 3 * (kMaxLevel - level - 1);
        for (std::size_t first = begin, past = begin; first < end; first = past) {
            const std::uint64_t next = ((mKeys[first] >> below) + 1) << below;
            const std::uint64_t* const at = mKeys.begin();
            past = std::size_t(std::lower_bound(at + first, at + end, next) - at);
            addBuckets(level + 1, first, past, most, buckets);
        }
    }

    OctreeCell coveringCell(OctreeCell cell, double radius) const;

    RootCube mRoot;
    Floats mFloats, mThinnedFloats; ///< what mPoints and mThinned point to
    PointArrays mPoints;
    PointArrays mThinned; ///< every kThinning-th point, so that samples of many are near each other
    std::vector<StoredArray<float>> mChannels;
    std::vector<std::string> mScalarNames;
    StoredArray<std::uint64_t> mKeys;
    int mTopLevel = 0;
    StoredArray<std::uint32_t> mTop; ///< first point of each cell of level mTopLevel
};

} // namespace mpuvdb
