// Leaves out a file's unusable points.
#include "no_data.h"
#include "raw_points.h"

#include "core/release.h"
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

/// The largest coordinate, world units. [derived: sums of squares of smaller ones fit a float]
constexpr double kMaxCoordinate = 1e15;

enum Fault : std::uint8_t {
    NotFinite,
    TooFar,
    IsNoData,
    NormalNotFinite,
    ZeroNormal,
    ZeroConfidence,
    kFaults
};

constexpr const char* kFaultNames[kFaults] = {
    "not finite", "too far", "no data", "normal not finite", "zero normal", "zero confidence"};

struct BlockFaults {
    std::array<std::uint64_t, kFaults> counts{};
    std::array<std::uint64_t, kFaults> first{};
    std::uint64_t total = 0;
};

// The fault of point i; kFaults without one.
Fault faultOf(const PointBlock& block, std::size_t i, const NoData& noData)
{
    const Vec3d& p = block.positions[i];
    // Written so that NaN fails.
    if (!(p.cwiseAbs().maxCoeff() <= kMaxCoordinate) || !p.allFinite())
        return p.allFinite() ? TooFar : NotFinite;
    if (noData.isAt(p)) return IsNoData;
    if (!block.normals.empty()) {
        const Vec3f& n = block.normals[i];
        if (!n.allFinite()) return NormalNotFinite;
        if (n == Vec3f::Zero()) return ZeroNormal;
    }
    if (!block.confidence.empty() && !(block.confidence[i] > 0)) return ZeroConfidence;
    return kFaults;
}

// The faults of points [begin, end); `first` counts from the block's beginning.
BlockFaults countFaults(const PointBlock& block, const NoData& noData, std::size_t begin,
                        std::size_t end)
{
    BlockFaults faults;
    for (std::size_t i = begin; i < end; ++i) {
        const Fault fault = faultOf(block, i, noData);
        if (fault == kFaults) continue;
        if (faults.counts[fault]++ == 0) faults.first[fault] = i;
        ++faults.total;
    }
    return faults;
}

// Adds the counts of points that come `offset` points later.
void addFaults(BlockFaults& all, const BlockFaults& more, std::uint64_t offset)
{
    for (std::size_t f = 0; f < kFaults; ++f) {
        if (all.counts[f] == 0 && more.counts[f] > 0) all.first[f] = offset + more.first[f];
        all.counts[f] += more.counts[f];
    }
    all.total += more.total;
}

BlockFaults countFaults(const PointBlock& block, const NoData& noData)
{
    std::vector<BlockFaults> slices((block.size() + kPointsPerSlice - 1) / kPointsPerSlice);
    tbb::parallel_for(std::size_t(0), slices.size(), [&](std::size_t s) {
        const std::size_t begin = s * kPointsPerSlice;
        slices[s] =
            countFaults(block, noData, begin, std::min(begin + kPointsPerSlice, block.size()));
    });
    BlockFaults all;
    for (const BlockFaults& slice : slices) addFaults(all, slice, 0);
    return all;
}

void dropFaults(PointBlock& block, const NoData& noData)
{
    std::vector<std::uint8_t> keep(block.size());
    for (std::size_t i = 0; i < keep.size(); ++i) keep[i] = faultOf(block, i, noData) == kFaults;
    block.compact(keep);
}

// Drops confidences and normals that are all empty: they would leave no points.
void ignoreEmptyAttributes(FilePoints& points)
{
    bool normals = false, positive = false, negative = false;
    float largest = 0;
    for (const PointBlock& block : points.blocks) {
        for (std::size_t i = 0; i < block.normals.size() && !normals; ++i)
            normals = block.normals[i] != Vec3f::Zero() && block.normals[i].allFinite();
        for (const float c : block.confidence) {
            positive = positive || c > 0;
            negative = negative || c < 0;
            if (std::isfinite(c)) largest = std::max(largest, c);
        }
        if (normals && block.confidence.empty()) break;
    }
    if (points.hasNormals() && !normals) {
        points.notes.push_back("its normals are all zero, and ignored");
        for (PointBlock& block : points.blocks) release(block.normals);
    }
    if (!points.hasConfidence()) return;
    if (!positive || negative || !(largest > 0)) {
        points.notes.push_back("its confidences are zero or negative, and ignored");
        for (PointBlock& block : points.blocks) release(block.confidence);
        return;
    }
    for (PointBlock& block : points.blocks)
        for (float& c : block.confidence) c = std::isfinite(c) ? c / largest : 0;
}

// Scalars do not move the surface: their points stay.
void zeroNonFiniteScalars(FilePoints& points)
{
    std::uint64_t zeroed = 0;
    for (PointBlock& block : points.blocks)
        for (std::vector<float>& values : block.scalars)
            for (float& value : values) {
                if (std::isfinite(value)) continue;
                value = 0;
                ++zeroed;
            }
    if (zeroed > 0)
        points.notes.push_back(
            fmt::format("{} of its scalars are not finite, and became 0", zeroed));
}

[[noreturn]] void throwFirst(const FilePoints& points, const BlockFaults& faults, Fault fault,
                             const std::string& what, std::uint64_t total)
{
    throw InputError(fmt::format("{}: {} {}: {} ({} of {} like it). Drop them with --bad-points "
                                 "drop, or export the file without them.",
                                 points.name, points.unit, faults.first[fault], what,
                                 faults.counts[fault], total));
}

} // namespace

void cleanPoints(FilePoints& points, BadPoints badPoints, Interrupter& progress)
{
    progress.check();
    ignoreEmptyAttributes(points);
    zeroNonFiniteScalars(points);
    const std::uint64_t total = points.size();
    const NoData noData(points);
    if (points.triangles.empty() && points.meshTriangles == 0) points.warnings = noData.doubts();
    std::vector<BlockFaults> ofBlocks(points.blocks.size());
    tbb::parallel_for(std::size_t(0), ofBlocks.size(),
                      [&](std::size_t b) { ofBlocks[b] = countFaults(points.blocks[b], noData); });
    BlockFaults faults;
    std::uint64_t before = 0;
    for (std::size_t b = 0; b < ofBlocks.size(); ++b) {
        addFaults(faults, ofBlocks[b], before);
        before += points.blocks[b].size();
    }
    for (std::size_t f = 0; f < kFaults; ++f) {
        if (faults.counts[f] == 0) continue;
        const std::string what = f == IsNoData ? noData.text() : kFaultNames[f];
        // A confidence of zero is the file's way to leave a point out, no fault.
        if (badPoints == BadPoints::Fail && f != ZeroConfidence)
            throwFirst(points, faults, Fault(f), what, total);
        points.dropped[what] += faults.counts[f];
    }
    tbb::parallel_for(std::size_t(0), ofBlocks.size(), [&](std::size_t b) {
        if (ofBlocks[b].total > 0) dropFaults(points.blocks[b], noData);
    });
}

} // namespace mpuvdb
