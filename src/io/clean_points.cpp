// What of a file cannot be used, and leaving it out.
#include "raw_points.h"

#include <mpuvdb/error.h>
#include <mpuvdb/progress.h>

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

// World units; squares and sums of what is nearer fit a float with room.
constexpr double kFarthest = 1e15;

enum Fault : std::uint8_t {
    NotFinite,
    TooFar,
    NormalNotFinite,
    ZeroNormal,
    ZeroConfidence,
    kFaults
};

constexpr const char* kFaultNames[kFaults] = {"not finite", "too far", "normal not finite",
                                              "zero normal", "zero confidence"};

struct BlockFaults {
    std::array<std::uint64_t, kFaults> counts{};
    std::array<std::uint64_t, kFaults> first{};
    std::uint64_t total = 0;
};

// What is wrong with point i; kFaults where nothing is.
Fault faultOf(const PointBlock& block, std::size_t i)
{
    const Vec3d& p = block.positions[i];
    // Written so that NaN fails.
    if (!(p.cwiseAbs().maxCoeff() <= kFarthest) || !p.allFinite())
        return p.allFinite() ? TooFar : NotFinite;
    if (!block.normals.empty()) {
        const Vec3f& n = block.normals[i];
        if (!n.allFinite()) return NormalNotFinite;
        if (n == Vec3f::Zero()) return ZeroNormal;
    }
    if (!block.confidence.empty() && !(block.confidence[i] > 0)) return ZeroConfidence;
    return kFaults;
}

BlockFaults cleanBlock(PointBlock& block, bool drop)
{
    BlockFaults faults;
    std::vector<std::uint8_t> keep;
    for (std::size_t i = 0; i < block.size(); ++i) {
        const Fault fault = faultOf(block, i);
        if (fault == kFaults) continue;
        if (keep.empty()) keep.assign(block.size(), 1);
        if (faults.counts[fault]++ == 0) faults.first[fault] = i;
        ++faults.total;
        keep[i] = 0;
    }
    if (drop && faults.total > 0) block.compact(keep);
    return faults;
}

// Confidences or normals that a program wrote without having any would leave no points.
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
        for (PointBlock& block : points.blocks) block.normals = {};
    }
    if (!points.hasConfidence()) return;
    if (!positive || negative || !(largest > 0)) {
        points.notes.push_back("its confidences are zero or negative, and ignored");
        for (PointBlock& block : points.blocks) block.confidence = {};
        return;
    }
    for (PointBlock& block : points.blocks)
        for (float& c : block.confidence) c = std::isfinite(c) ? c / largest : 0;
}

[[noreturn]] void throwFirst(const FilePoints& points,
                             const std::array<std::uint64_t, kFaults>& counts, Fault fault,
                             std::uint64_t index, std::uint64_t total)
{
    throw InputError(fmt::format("{}: {} {}: {} ({} of {} like it). Drop them with --bad-points "
                                 "drop, or export the file without them.",
                                 points.name, points.unit, index, kFaultNames[fault], counts[fault],
                                 total));
}

} // namespace

void cleanPoints(FilePoints& points, BadPoints badPoints, Progress& progress)
{
    progress.check();
    ignoreEmptyAttributes(points);
    const std::uint64_t total = points.size();
    std::vector<BlockFaults> faults(points.blocks.size());
    tbb::parallel_for(std::size_t(0), faults.size(), [&](std::size_t b) {
        faults[b] = cleanBlock(points.blocks[b], badPoints == BadPoints::Drop);
    });
    std::array<std::uint64_t, kFaults> counts{}, first{};
    std::uint64_t before = 0;
    for (std::size_t b = 0; b < faults.size(); ++b) {
        for (std::size_t f = 0; f < kFaults; ++f) {
            if (counts[f] == 0 && faults[b].counts[f] > 0) first[f] = before + faults[b].first[f];
            counts[f] += faults[b].counts[f];
        }
        before += points.blocks[b].size() + (badPoints == BadPoints::Drop ? faults[b].total : 0);
    }
    for (std::size_t f = 0; f < kFaults; ++f) {
        if (counts[f] == 0) continue;
        // A confidence of zero is a statement about a point, not a fault of the file.
        if (badPoints == BadPoints::Fail && f != ZeroConfidence)
            throwFirst(points, counts, Fault(f), first[f], total);
        points.dropped[kFaultNames[f]] += counts[f];
    }
    if (badPoints == BadPoints::Fail && counts[ZeroConfidence] > 0)
        for (PointBlock& block : points.blocks) cleanBlock(block, true);
}

} // namespace mpuvdb
