// All inputs about one frame.
#include "raw_points.h"

#include <mpuvdb/error.h>
#include <mpuvdb/progress.h>

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <limits>

#ifdef __GLIBC__
#include <malloc.h>
#endif

namespace mpuvdb
{
namespace
{

using Inputs = std::vector<FilePoints>;

// Blocks of all inputs, in order, with the place of each in the joined cloud.
struct Placed {
    PointBlock* block;
    std::size_t first;
};

std::vector<Placed> placeBlocks(Inputs& inputs)
{
    std::vector<Placed> placed;
    std::size_t first = 0;
    for (FilePoints& input : inputs)
        for (PointBlock& block : input.blocks) {
            placed.push_back({&block, first});
            first += block.size();
        }
    return placed;
}

Box3d boundsOf(const Inputs& inputs, const Box3d& within)
{
    Box3d box;
    for (const FilePoints& input : inputs)
        for (const PointBlock& block : input.blocks)
            for (const Vec3d& p : block.positions)
                if (within.contains(p)) box.extend(p);
    return box;
}

constexpr std::uint64_t kManyPoints = 1 << 20;
constexpr int kBins = 2048;

// A box that leaves out what is more than a hundred times as far away as 95 % of the points are
// from each other, or @a box itself. Counts do not depend on the points' order.
Box3d denseCore(const Inputs& inputs, const Box3d& box)
{
    const Vec3d scale =
        (box.sizes().array() > 0)
            .select(kBins / box.sizes().array().max(1e-300), Eigen::Array3d::Zero());
    std::array<std::vector<std::uint64_t>, 3> bins;
    for (auto& axis : bins) axis.assign(kBins, 0);
    std::uint64_t points = 0;
    for (const FilePoints& input : inputs)
        for (const PointBlock& block : input.blocks)
            for (const Vec3d& p : block.positions) {
                if (!box.contains(p)) continue;
                ++points;
                for (int a = 0; a < 3; ++a)
                    ++bins[std::size_t(a)][std::size_t(
                        std::clamp(int((p[a] - box.min()[a]) * scale[a]), 0, kBins - 1))];
            }
    Box3d core = box;
    for (int a = 0; a < 3; ++a) {
        const auto& count = bins[std::size_t(a)];
        int best = 0;
        for (int b = 0; b + 1 < kBins; ++b)
            if (count[b] + count[b + 1] > count[best] + count[best + 1]) best = b;
        if (scale[a] == 0 || 20 * (count[best] + count[best + 1]) < 19 * points) continue;
        core.min()[a] = std::max(box.min()[a], box.min()[a] + (best - 8) / scale[a]);
        core.max()[a] = std::min(box.max()[a], box.min()[a] + (best + 10) / scale[a]);
    }
    return 100 * core.sizes().maxCoeff() < box.sizes().maxCoeff() ? core : box;
}

// The box of all points but those so far away that the rest would be a speck beside them.
Box3d usefulBounds(const Inputs& inputs)
{
    const double inf = std::numeric_limits<double>::infinity();
    Box3d box = boundsOf(inputs, Box3d(Vec3d::Constant(-inf), Vec3d::Constant(inf)));
    for (;;) {
        const Box3d core = denseCore(inputs, box);
        if (core.isApprox(box)) return box;
        box = boundsOf(inputs, core);
    }
}

void dropOutside(Inputs& inputs, const Box3d& box, BadPoints badPoints)
{
    for (FilePoints& input : inputs) {
        std::uint64_t outside = 0;
        for (PointBlock& block : input.blocks) {
            std::vector<std::uint8_t> keep(block.size());
            for (std::size_t i = 0; i < keep.size(); ++i)
                keep[i] = box.contains(block.positions[i]);
            const auto left = std::uint64_t(std::count(keep.begin(), keep.end(), 0));
            if (left > 0) block.compact(keep);
            outside += left;
        }
        if (outside == 0) continue;
        if (badPoints == BadPoints::Fail)
            throw InputError(fmt::format("{}: {} points are more than a hundred times as far away "
                                         "as the others. Drop them with --bad-points drop.",
                                         input.name, outside));
        input.dropped["too far"] += outside;
    }
}

// Normals and colours are kept if every input has them; points without a confidence have 1.
void unifyAttributes(Inputs& inputs, std::vector<std::string>& notes)
{
    const auto lacking = [&](bool (FilePoints::*has)() const, const char* what) {
        const FilePoints *with = nullptr, *without = nullptr;
        for (const FilePoints& input : inputs) {
            if (input.size() == 0) continue;
            const FilePoints*& seen = (input.*has)() ? with : without;
            if (!seen) seen = &input;
        }
        if (with && without)
            notes.push_back(fmt::format("{} has no {}: those of the other inputs are ignored",
                                        without->name, what));
        return without != nullptr;
    };
    const bool noNormals = lacking(&FilePoints::hasNormals, "normals");
    const bool noColors = lacking(&FilePoints::hasColors, "colours");
    const bool confidence = std::any_of(inputs.begin(), inputs.end(),
                                        [](const FilePoints& f) { return f.hasConfidence(); });
    for (FilePoints& input : inputs)
        for (PointBlock& block : input.blocks) {
            if (noNormals) block.normals = {};
            if (noColors) block.colors = {};
            if (confidence && block.confidence.empty()) block.confidence.assign(block.size(), 1.f);
        }
}

// Copies one block to its place and frees it.
void placeBlock(PointBlock& block, std::size_t first, PointCloud& cloud)
{
    for (std::size_t i = 0; i < block.size(); ++i) {
        cloud.positions[first + i] = (block.positions[i] - cloud.frame).cast<float>();
        if (!block.normals.empty())
            cloud.normals[first + i] = block.normals[i].cast<double>().normalized().cast<float>();
    }
    std::copy(block.confidence.begin(), block.confidence.end(),
              cloud.confidence.begin() + std::ptrdiff_t(cloud.confidence.empty() ? 0 : first));
    std::copy(block.colors.begin(), block.colors.end(),
              cloud.colors.begin() + std::ptrdiff_t(cloud.colors.empty() ? 0 : first));
    block = PointBlock();
}

void requirePoints(const Inputs& inputs, std::uint64_t points,
                   const std::map<std::string, std::uint64_t>& dropped)
{
    if (points > std::numeric_limits<std::uint32_t>::max())
        throw LimitError(fmt::format("{} points are more than 4294967295: thin them, or work on "
                                     "parts.",
                                     points));
    if (points > 0) return;
    std::string why;
    for (const auto& [reason, count] : dropped)
        why += fmt::format(", {} left out: {}", count, reason);
    throw InputError(fmt::format("{}: no points to use{}. Check what was exported.",
                                 inputs.empty() ? "input" : inputs.front().name, why));
}

} // namespace

PointInput joinPoints(std::vector<FilePoints>&& inputs, BadPoints badPoints, Progress& progress)
{
    PointInput result;
    progress.check();
    const Box3d box = usefulBounds(inputs);
    dropOutside(inputs, box, badPoints);
    std::uint64_t points = 0;
    for (const FilePoints& input : inputs) {
        points += input.size();
        for (const auto& [reason, count] : input.dropped) result.dropped[reason] += count;
        for (const std::string& note : input.notes)
            result.notes.push_back(input.name + ": " + note);
    }
    requirePoints(inputs, points, result.dropped);
    unifyAttributes(inputs, result.notes);

    PointCloud& cloud = result.cloud;
    cloud.frame = box.center();
    const auto any = [&](bool (FilePoints::*has)() const) {
        return std::any_of(inputs.begin(), inputs.end(),
                           [&](const FilePoints& input) { return (input.*has)(); });
    };
    cloud.positions.resize(points);
    if (any(&FilePoints::hasNormals)) cloud.normals.resize(points);
    if (any(&FilePoints::hasConfidence)) cloud.confidence.resize(points);
    if (any(&FilePoints::hasColors)) cloud.colors.resize(points);
    const std::vector<Placed> placed = placeBlocks(inputs);
    tbb::parallel_for(std::size_t(0), placed.size(), [&](std::size_t i) {
        progress.check();
        placeBlock(*placed[i].block, placed[i].first, cloud);
    });
    inputs.clear();
#ifdef __GLIBC__
    // The blocks lay scattered in the heap, which would keep their pages.
    if (points > kManyPoints) malloc_trim(0);
#endif
    const std::uint64_t duplicates = dropDuplicates(cloud, progress);
    if (duplicates > 0) result.dropped["duplicate"] = duplicates;
    return result;
}

} // namespace mpuvdb
