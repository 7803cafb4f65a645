#include "sorted_points.h"

#include "core/morton.h"
#include "core/release.h"
#include "files/array_file.h"
#include "spatial/key_order.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <numeric>
#include <tbb/parallel_for.h>
#include <tuple>
#include <utility>

namespace mpuvdb
{
namespace
{

/// Names of a point's numbers in a file. [derived: those of the arrays]
constexpr std::array<const char*, 7> kFloatNames = {"x", "y", "z", "nx", "ny", "nz", "confidence"};

std::string thinnedName(std::size_t n)
{
    return std::string("thinned ") + kFloatNames[n];
}

std::string channelName(std::size_t n)
{
    return "channel " + std::to_string(n);
}

std::string scalarName(std::size_t n)
{
    return "scalar " + std::to_string(n);
}

/// How a point's color and scalars are ordered before another's, where all else is equal.
bool attributesBefore(const PointCloud& cloud, std::uint32_t a, std::uint32_t b)
{
    if (!cloud.colors.empty() && cloud.colors[a] != cloud.colors[b])
        return cloud.colors[a] < cloud.colors[b];
    for (const NamedScalars& scalars : cloud.scalars)
        if (scalars.values[a] != scalars.values[b]) return scalars.values[a] < scalars.values[b];
    return false;
}

/// Morton keys of the points of a cloud in a cube.
class PointKeys
{
public:
    PointKeys(const std::vector<Vec3f>& positions, const RootCube& root)
        : mPositions(positions), mCorner(root.corner),
          mScale(std::ldexp(1 / root.side, SortedPoints::kMaxLevel))
    {
    }
    std::uint64_t operator()(std::uint32_t n) const
    {
        const double last = std::ldexp(1.0, SortedPoints::kMaxLevel) - 1;
        const Vec3d p = (mPositions[n].cast<double>() - mCorner) * mScale;
        const auto q = p.cwiseMax(0).cwiseMin(last).cast<std::uint64_t>();
        return mortonKey(q[0], q[1], q[2]);
    }

private:
    const std::vector<Vec3f>& mPositions;
    const Vec3d mCorner;
    const double mScale;
};

/// The points' order by key; where keys are equal, by all other values.
std::vector<std::uint32_t> sortedOrder(const PointCloud& cloud, const PointKeys& keys,
                                       Interrupter& progress)
{
    const bool confident = !cloud.confidence.empty();
    const auto attributes = [&](std::uint32_t n) {
        const Vec3f &p = cloud.positions[n], &v = cloud.normals[n];
        return std::make_tuple(p[0], p[1], p[2], v[0], v[1], v[2],
                               confident ? cloud.confidence[n] : 1.0f);
    };
    const auto isBefore = [&](std::uint32_t a, std::uint32_t b) {
        const auto first = attributes(a), second = attributes(b);
        return first < second || (first == second && attributesBefore(cloud, a, b));
    };
    return orderByKeys(cloud.size(), 3 * SortedPoints::kMaxLevel, keys, isBefore, progress);
}

/// Merge the points of each position, which are adjacent, as points of one key are sorted by it.
void mergeCopies(PointBatch& p, std::vector<std::uint64_t>& keys,
                 std::vector<PointBatch::Floats>& channels)
{
    const auto same = [&p](std::size_t a, std::size_t b) {
        return p.x[a] == p.x[b] && p.y[a] == p.y[b] && p.z[a] == p.z[b];
    };
    std::size_t kept = 0;
    for (std::size_t n = 0, end = 0; n < p.size(); n = end, ++kept) {
        while (end < p.size() && same(n, end)) ++end;
        const auto keep = [&](PointBatch::Floats& a) { a[kept] = a[n]; };
        p.forEach(keep);
        std::for_each(channels.begin(), channels.end(), keep);
        keys[kept] = keys[n];
        if (end - n < 2) continue;
        Vec3d normal = Vec3d::Zero();
        double weight = 0;
        for (std::size_t k = n; k < end; ++k) {
            normal += double(p.confidence[k]) * Vec3d(p.nx[k], p.ny[k], p.nz[k]);
            weight += double(p.confidence[k]);
        }
        p.confidence[kept] = float(weight / double(end - n));
        for (PointBatch::Floats& channel : channels)
            channel[kept] = float(std::accumulate(channel.begin() + std::ptrdiff_t(n),
                                                  channel.begin() + std::ptrdiff_t(end), 0.0) /
                                  double(end - n));
        // Normals that cancel leave the first one.
        if (!(normal.norm() > 1e-3 * weight)) continue;
        const Vec3f mean = normal.normalized().cast<float>();
        p.nx[kept] = mean[0], p.ny[kept] = mean[1], p.nz[kept] = mean[2];
    }
    p.resize(kept);
    for (PointBatch::Floats& channel : channels) channel.resize(kept);
    keys.resize(kept);
}

} // namespace

SortedPoints::SortedPoints(PointCloud&& cloud, const RootCube& root, Interrupter& progress,
                           Copies copies)
    : mRoot(root)
{
    const PointKeys keyOf(cloud.positions, root);
    std::vector<std::uint32_t> order = sortedOrder(cloud, keyOf, progress);
    const std::size_t count = order.size();
    const auto permute = [&](auto& out, auto value) {
        out.resize(count);
        tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, 1 << 14),
                          [&](const tbb::blocked_range<std::size_t>& range) {
                              for (std::size_t n = range.begin(); n < range.end(); ++n)
                                  out[n] = value(order[n]);
                          });
        progress.check();
    };
    PointBatch points;
    permute(points.x, [&](std::uint32_t n) { return cloud.positions[n][0]; });
    permute(points.y, [&](std::uint32_t n) { return cloud.positions[n][1]; });
    permute(points.z, [&](std::uint32_t n) { return cloud.positions[n][2]; });
    std::vector<std::uint64_t> keys;
    permute(keys, keyOf);
    release(cloud.positions);
    permute(points.nx, [&](std::uint32_t n) { return cloud.normals[n][0]; });
    permute(points.ny, [&](std::uint32_t n) { return cloud.normals[n][1]; });
    permute(points.nz, [&](std::uint32_t n) { return cloud.normals[n][2]; });
    release(cloud.normals);
    if (cloud.confidence.empty())
        points.confidence.assign(count, 1.0f);
    else
        permute(points.confidence, [&](std::uint32_t n) { return cloud.confidence[n]; });
    release(cloud.confidence);
    std::vector<PointBatch::Floats> channels;
    for (int c = 0; c < 3 && !cloud.colors.empty(); ++c)
        permute(channels.emplace_back(),
                [&](std::uint32_t n) { return linearColor(cloud.colors[n])[c]; });
    release(cloud.colors);
    for (const NamedScalars& scalars : cloud.scalars) {
        mScalarNames.push_back(scalars.name);
        permute(channels.emplace_back(), [&](std::uint32_t n) { return scalars.values[n]; });
    }
    release(cloud.scalars);
    release(order);
    if (copies == Copies::Merge) mergeCopies(points, keys, channels);
    for (PointBatch::Floats& channel : channels) mChannels.emplace_back(std::move(channel));
    hold(std::move(points), std::move(keys));
}

SortedPoints::SortedPoints(PointBatch&& points, std::vector<std::uint64_t>&& keys,
                           const RootCube& root)
    : mRoot(root)
{
    hold(std::move(points), std::move(keys));
}

/// Hold @a points in the order of their @a keys, with a table of first points of about an entry per
/// point; below its level cells are searched.
void SortedPoints::hold(PointBatch&& points, std::vector<std::uint64_t>&& keys)
{
    while (std::size_t(8) << 3 * mTopLevel <= keys.size()) ++mTopLevel;
    std::vector<std::uint32_t> top((std::size_t(1) << 3 * mTopLevel) + 1);
    std::size_t first = 0;
    for (std::size_t cell = 0; cell < top.size(); ++cell) {
        while (first < keys.size() && keys[first] >> 3 * (kMaxLevel - mTopLevel) < cell) ++first;
        top[cell] = std::uint32_t(first);
    }
    mTop = std::move(top);
    mKeys = std::move(keys);
    Floats thinned;
    std::size_t n = 0;
    points.forEach([&](const PointBatch::Floats& all) {
        std::vector<float> some;
        for (std::size_t at = 0; at < all.size(); at += kThinning) some.push_back(all[at]);
        thinned[n++] = std::move(some);
    });
    hold({std::move(points.x), std::move(points.y), std::move(points.z), std::move(points.nx),
          std::move(points.ny), std::move(points.nz), std::move(points.confidence)},
         thinned);
}

void SortedPoints::hold(const Floats& floats, const Floats& thinned)
{
    const auto arraysOf = [](const Floats& a) -> PointArrays {
        return {a[0].data(), a[1].data(), a[2].data(), a[3].data(),
                a[4].data(), a[5].data(), a[6].data(), a[0].size()};
    };
    mFloats = floats;
    mPoints = arraysOf(mFloats);
    mThinnedFloats = thinned;
    mThinned = arraysOf(mThinnedFloats);
}

SortedPoints::SortedPoints(const ArrayFile& file, const std::string& prefix, const RootCube& root)
    : mRoot(root), mKeys(file.get<std::uint64_t>(prefix + "keys")),
      mTopLevel(file.value<std::int32_t>(prefix + "top level")),
      mTop(file.get<std::uint32_t>(prefix + "top"))
{
    Floats floats, thinned;
    for (std::size_t n = 0; n < floats.size(); ++n) {
        floats[n] = file.get<float>(prefix + kFloatNames[n]);
        thinned[n] = file.get<float>(prefix + thinnedName(n));
    }
    hold(floats, thinned);
    for (std::size_t c = 0; file.has(prefix + channelName(c)); ++c)
        mChannels.push_back(file.get<float>(prefix + channelName(c)));
    for (std::size_t c = 0; file.has(prefix + scalarName(c)); ++c) {
        const StoredArray<char> name = file.get<char>(prefix + scalarName(c));
        mScalarNames.emplace_back(name.begin(), name.end());
    }
}

void SortedPoints::save(ArrayFileWriter& file, const std::string& prefix) const&
{
    SortedPoints(*this).save(file, prefix); // shares the arrays
}

void SortedPoints::save(ArrayFileWriter& file, const std::string& prefix) &&
{
    const auto move = [&](const std::string& name, auto& array) {
        file.add(prefix + name, array);
        array = {};
    };
    for (std::size_t n = 0; n < mFloats.size(); ++n) {
        move(kFloatNames[n], mFloats[n]);
        move(thinnedName(n), mThinnedFloats[n]);
    }
    move("keys", mKeys);
    file.addValue(prefix + "top level", std::int32_t(mTopLevel));
    move("top", mTop);
    for (std::size_t c = 0; c < mChannels.size(); ++c) move(channelName(c), mChannels[c]);
    for (std::size_t c = 0; c < mScalarNames.size(); ++c)
        file.add(prefix + scalarName(c), mScalarNames[c]);
}

std::size_t SortedPoints::bytes() const
{
    std::size_t all = mKeys.bytes() + mTop.bytes();
    for (const Floats& floats : {mFloats, mThinnedFloats})
        for (const StoredArray<float>& array : floats) all += array.bytes();
    for (const auto& channel : mChannels) all += channel.bytes();
    return all;
}

SortedPoints::Range SortedPoints::cellRange(const OctreeCell& cell) const
{
    const int below = 3 * (kMaxLevel - cell.level);
    const std::uint64_t key = mortonKey(cell.i, cell.j, cell.k);
    const std::uint64_t firstKey = key << below, endKey = (key + 1) << below;
    const int topShift = 3 * (kMaxLevel - mTopLevel);
    const std::uint64_t* const begin = mKeys.begin();
    if (cell.level <= mTopLevel) return {mTop[firstKey >> topShift], mTop[endKey >> topShift]};
    const std::size_t top = std::size_t(firstKey >> topShift);
    const std::uint64_t *const lo = begin + mTop[top], *const hi = begin + mTop[top + 1];
    const std::uint64_t* const first = std::lower_bound(lo, hi, firstKey);
    const std::uint64_t* const end = std::lower_bound(first, hi, endKey);
    return {std::size_t(first - begin), std::size_t(end - begin)};
}

/// The ancestor that, with its 26 neighbors, covers the ball about the cell's center.
OctreeCell SortedPoints::coveringCell(OctreeCell cell, double radius) const
{
    const double half = mRoot.size(cell.level) / 2;
    while (cell.level > kMaxLevel || (cell.level > 0 && mRoot.size(cell.level) + half < radius))
        cell = {cell.level - 1, cell.i / 2, cell.j / 2, cell.k / 2};
    return cell;
}

SortedPoints::Around SortedPoints::around(const OctreeCell& center, double radius) const
{
    Around around{center, radius};
    const OctreeCell cell = coveringCell(center, radius);
    const std::int64_t edge = std::int64_t(1) << cell.level;
    for (int dk = -1; dk <= 1; ++dk) {
        for (int dj = -1; dj <= 1; ++dj) {
            for (int di = -1; di <= 1; ++di) {
                const std::int64_t i = std::int64_t(cell.i) + di, j = std::int64_t(cell.j) + dj,
                                   k = std::int64_t(cell.k) + dk;
                if (i < 0 || j < 0 || k < 0 || i >= edge || j >= edge || k >= edge) continue;
                const Range range =
                    cellRange({cell.level, std::uint32_t(i), std::uint32_t(j), std::uint32_t(k)});
                if (range.begin == range.end) continue;
                around.ranges[around.count++] = range;
                around.points += range.end - range.begin;
            }
        }
    }
    return around;
}

std::size_t SortedPoints::gather(const Around& around, std::size_t stride, BatchFilter& filter,
                                 PointBatch& out) const
{
    out.clear();
    const Vec3d center = mRoot.center(around.cell);
    const std::size_t thinning = stride < kThinning ? 1 : kThinning;
    const std::size_t step = stride / thinning;
    const PointArrays& from = thinning == 1 ? mPoints : mThinned;
    const auto placeOf = [thinning](std::size_t n) { return (n + thinning - 1) / thinning; };
    std::size_t skip = 0;
    for (std::size_t n = 0; n < around.count; ++n) {
        const std::size_t end = placeOf(around.ranges[n].end);
        const std::size_t first = placeOf(around.ranges[n].begin) + skip;
        filter.appendBall(from, first, end, step, center, around.radius, out);
        const std::size_t past = end + step - 1 - first; // first may be beyond the end
        skip = first + past / step * step - end;
    }
    return step * thinning;
}

int SortedPoints::levelOfCells(double count) const
{
    const auto isAbove = [&](int level) {
        std::size_t cells = 0;
        forEachCell(level, [&](std::size_t, std::size_t) { ++cells; });
        return double(cells) * count <= double(size());
    };
    int level = 0;
    while (level < kMaxLevel && isAbove(level + 1)) ++level;
    return level;
}

void SortedPoints::addRanges(const Box3d& box, const OctreeCell& cell,
                             std::vector<Range>& ranges) const
{
    const Vec3d half = Vec3d::Constant(mRoot.size(cell.level) / 2), center = mRoot.center(cell);
    const Box3d cube(center - half, center + half);
    if (!box.intersects(cube)) return;
    const Range range = cellRange(cell);
    if (range.begin == range.end) return;
    if (box.contains(cube) || range.end - range.begin <= kMaxScanPoints ||
        cell.level == kMaxLevel) {
        if (!ranges.empty() && ranges.back().end == range.begin)
            ranges.back().end = range.end;
        else
            ranges.push_back(range);
        return;
    }
    for (int octant = 0; octant < 8; ++octant) addRanges(box, cell.child(octant), ranges);
}

std::vector<SortedPoints::Range> SortedPoints::rangesIn(const Box3d& box) const
{
    std::vector<Range> ranges;
    addRanges(box, {}, ranges);
    return ranges;
}

std::size_t SortedPoints::countIn(const Box3d& box, std::size_t limit, const OctreeCell& cell) const
{
    const Vec3d half = Vec3d::Constant(mRoot.size(cell.level) / 2), center = mRoot.center(cell);
    const Box3d cube(center - half, center + half);
    if (!box.intersects(cube)) return 0;
    const Range range = cellRange(cell);
    if (range.begin == range.end) return 0;
    if (box.contains(cube)) return range.end - range.begin;
    std::size_t count = 0;
    if (range.end - range.begin <= kMaxScanPoints || cell.level == kMaxLevel) {
        for (std::size_t n = range.begin; n < range.end; ++n)
            count += box.contains(Vec3d(mPoints.x[n], mPoints.y[n], mPoints.z[n]));
        return count;
    }
    // First where most of the box is, so that few points are soon found.
    const Vec3d toward = box.center() - center;
    const int first = (toward[0] > 0 ? 1 : 0) | (toward[1] > 0 ? 2 : 0) | (toward[2] > 0 ? 4 : 0);
    for (int n = 0; n < 8 && count < limit; ++n)
        count += countIn(box, limit, cell.child(n ^ first));
    return count;
}

} // namespace mpuvdb
