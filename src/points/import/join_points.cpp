// Joins all inputs about one frame.
#include "files/text_scan.h"
#include "raw_points.h"

#include "core/release.h"
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <fmt/format.h>
#include <tbb/enumerable_thread_specific.h>
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

// A part of a block, with the index of its first point in the joined cloud.
struct Slice {
    const PointBlock* block = nullptr;
    std::size_t begin = 0, end = 0, place = 0;
    std::uint32_t seenFrom = PointCloud::kUnseen; ///< index into the cloud's viewpoints
};

std::vector<Slice> slicesOf(const Inputs& inputs)
{
    std::vector<Slice> slices;
    std::size_t place = 0;
    std::uint32_t viewpoints = 0;
    for (const FilePoints& input : inputs)
        for (const PointBlock& block : input.blocks) {
            const std::uint32_t seenFrom = block.seenFrom ? viewpoints++ : PointCloud::kUnseen;
            for (std::size_t begin = 0; begin < block.size(); begin += kPointsPerSlice) {
                const std::size_t end = std::min(begin + kPointsPerSlice, block.size());
                slices.push_back({&block, begin, end, place, seenFrom});
                place += end - begin;
            }
        }
    return slices;
}

Box3d boundsOf(const std::vector<Slice>& slices, const Box3d& within)
{
    std::vector<Box3d> boxes(slices.size());
    tbb::parallel_for(std::size_t(0), slices.size(), [&](std::size_t s) {
        const std::vector<Vec3d>& positions = slices[s].block->positions;
        for (std::size_t i = slices[s].begin; i < slices[s].end; ++i)
            if (within.contains(positions[i])) boxes[s].extend(positions[i]);
    });
    Box3d all;
    for (const Box3d& box : boxes) all.extend(box);
    return all;
}

/// The points above which free memory is given back to the system. [free: time]
constexpr std::uint64_t kTrimPoints = 1 << 20;
/// The bins along an axis. [derived: a core of 18 bins is then less than a hundredth of the box]
constexpr int kBins = 2048;

// The number of points in each bin of a box's three axes.
struct Bins {
    std::array<std::array<std::uint64_t, kBins>, 3> counts{};
    std::uint64_t points = 0;
};

Bins countBins(const std::vector<Slice>& slices, const Box3d& box, const Vec3d& scale)
{
    tbb::enumerable_thread_specific<Bins> ofThreads;
    tbb::parallel_for(std::size_t(0), slices.size(), [&](std::size_t s) {
        Bins& bins = ofThreads.local();
        for (std::size_t i = slices[s].begin; i < slices[s].end; ++i) {
            const Vec3d& p = slices[s].block->positions[i];
            if (!box.contains(p)) continue;
            ++bins.points;
            for (int a = 0; a < 3; ++a) {
                const int bin = std::min(int((p[a] - box.min()[a]) * scale[a]), kBins - 1);
                ++bins.counts[std::size_t(a)][std::size_t(bin)];
            }
        }
    });
    Bins all;
    for (const Bins& bins : ofThreads) { // whole numbers: their order does not matter
        all.points += bins.points;
        for (std::size_t a = 0; a < 3; ++a)
            for (std::size_t b = 0; b < kBins; ++b) all.counts[a][b] += bins.counts[a][b];
    }
    return all;
}

// A box that leaves out points more than a hundred times as far away as 95 % of the others are from
// each other, or @a box itself. Independent of the points' order.
Box3d denseCore(const std::vector<Slice>& slices, const Box3d& box)
{
    Vec3d scale = Vec3d::Zero();
    for (int a = 0; a < 3; ++a)
        if (box.sizes()[a] > 0) scale[a] = kBins / box.sizes()[a];
    const Bins bins = countBins(slices, box, scale);
    Box3d core = box;
    for (int a = 0; a < 3; ++a) {
        const auto& count = bins.counts[std::size_t(a)];
        std::size_t best = 0;
        for (std::size_t b = 0; b + 1 < kBins; ++b)
            if (count[b] + count[b + 1] > count[best] + count[best + 1]) best = b;
        if (scale[a] == 0 || 20 * (count[best] + count[best + 1]) < 19 * bins.points) continue;
        core.min()[a] = std::max(box.min()[a], box.min()[a] + (double(best) - 8) / scale[a]);
        core.max()[a] = std::min(box.max()[a], box.min()[a] + (double(best) + 10) / scale[a]);
    }
    return 100 * core.sizes().maxCoeff() < box.sizes().maxCoeff() ? core : box;
}

Box3d everywhere()
{
    const double inf = std::numeric_limits<double>::infinity();
    return Box3d(Vec3d::Constant(-inf), Vec3d::Constant(inf));
}

// The box of all points but those that denseCore() leaves out, repeatedly.
Box3d usefulBounds(const std::vector<Slice>& slices, Box3d box)
{
    for (;;) {
        const Box3d core = denseCore(slices, box);
        if (core.min() == box.min() && core.max() == box.max()) return box;
        box = boundsOf(slices, core);
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

// Normals and colors are kept if every input has them; points without a confidence have 1.
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
    const bool noColors = lacking(&FilePoints::hasColors, "colors");
    const bool confidence = std::any_of(inputs.begin(), inputs.end(),
                                        [](const FilePoints& f) { return f.hasConfidence(); });
    for (FilePoints& input : inputs)
        for (PointBlock& block : input.blocks) {
            if (noNormals) release(block.normals);
            if (noColors) release(block.colors);
            if (confidence && block.confidence.empty()) block.confidence.assign(block.size(), 1.f);
        }
}

/// The names that all inputs have, in the first one's order, and those that only some have.
void nameScalars(const Inputs& inputs, PointInput& result)
{
    for (const FilePoints& input : inputs)
        for (const std::string& name : input.scalarNames) {
            const auto lacks = [&](const FilePoints& other) {
                const auto& names = other.scalarNames;
                return std::find(names.begin(), names.end(), name) == names.end();
            };
            const auto without = std::find_if(inputs.begin(), inputs.end(), lacks);
            if (without != inputs.end())
                result.partialScalars.emplace(name, without->name);
            else if (&input == &inputs.front())
                result.scalarNames.push_back(name);
        }
}

// Copies a slice to its place.
void placeSlice(const Slice& slice, PointCloud& cloud)
{
    const PointBlock& block = *slice.block;
    const auto at = [&](std::size_t i) { return slice.place + i - slice.begin; };
    for (std::size_t i = slice.begin; i < slice.end; ++i)
        cloud.positions[at(i)] = (block.positions[i] - cloud.frame).cast<float>();
    for (std::size_t i = slice.begin; i < slice.end && !cloud.normals.empty(); ++i)
        cloud.normals[at(i)] = block.normals[i].cast<double>().normalized().cast<float>();
    for (std::size_t i = slice.begin; i < slice.end && !cloud.confidence.empty(); ++i)
        cloud.confidence[at(i)] = block.confidence[i];
    for (std::size_t i = slice.begin; i < slice.end && !cloud.colors.empty(); ++i)
        cloud.colors[at(i)] = block.colors[i];
    for (std::size_t n = 0; n < cloud.scalars.size(); ++n)
        std::copy(block.scalars[n].begin() + std::ptrdiff_t(slice.begin),
                  block.scalars[n].begin() + std::ptrdiff_t(slice.end),
                  cloud.scalars[n].values.begin() + std::ptrdiff_t(slice.place));
    for (std::size_t i = slice.begin; i < slice.end && !cloud.seenFrom.empty(); ++i)
        cloud.seenFrom[at(i)] = slice.seenFrom;
}

// Copies all blocks to their places, and frees them as it goes: there is never all of both.
void placeBlocks(Inputs& inputs, PointCloud& cloud, Interrupter& progress)
{
    constexpr std::size_t kAtOnce = 256; // slices; [free: the same cloud]
    const std::vector<Slice> slices = slicesOf(inputs);
    std::vector<PointBlock*> blocks;
    for (FilePoints& input : inputs)
        for (PointBlock& block : input.blocks) blocks.push_back(&block);
    auto held = blocks.begin();
    for (std::size_t begin = 0, end = 0; begin < slices.size(); begin = end) {
        end = std::min(begin + kAtOnce, slices.size());
        tbb::parallel_for(begin, end, [&](std::size_t s) {
            progress.check();
            placeSlice(slices[s], cloud);
        });
        const PointBlock* const next = end < slices.size() ? slices[end].block : nullptr;
        for (; held != blocks.end() && *held != next; ++held) **held = PointBlock();
    }
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
    throw InputError(fmt::format("{}: no points to use{}{}. Check what was exported.",
                                 inputs.empty() ? "input" : inputs.front().name, why,
                                 inputs.empty() ? "" : butNotes(inputs.front())));
}

} // namespace

void requireScalars(const FilePoints& input, const ScalarNames& scalars)
{
    for (std::size_t n = 0; n < scalars.size(); ++n)
        if (!input.hasScalar(n))
            throw InputError(fmt::format("{}: has no '{}' at its points{}. Name what all inputs "
                                         "have, or leave it out.",
                                         input.name, scalars[n],
                                         input.scalarNames.empty()
                                             ? std::string()
                                             : ", but " + listInQuotes(input.scalarNames)));
}

PointInput joinPoints(std::vector<FilePoints>&& inputs, BadPoints badPoints,
                      const ScalarNames& scalars, Interrupter& progress)
{
    PointInput result;
    progress.check();
    const std::vector<Slice> slices = slicesOf(inputs);
    const Box3d all = boundsOf(slices, everywhere());
    const Box3d box = usefulBounds(slices, all);
    if (!box.contains(all)) dropOutside(inputs, box, badPoints);
    std::uint64_t points = 0;
    for (const FilePoints& input : inputs) {
        points += input.size();
        result.triangles += input.meshTriangles;
        for (const auto& [reason, count] : input.dropped) result.dropped[reason] += count;
        for (const std::string& note : input.notes)
            result.notes.push_back(input.name + ": " + note);
        for (const std::string& warning : input.warnings)
            result.warnings.push_back(input.name + ": " + warning);
    }
    requirePoints(inputs, points, result.dropped);
    unifyAttributes(inputs, result.notes);
    for (const FilePoints& input : inputs)
        if (input.size() > 0) requireScalars(input, scalars);
    nameScalars(inputs, result);

    PointCloud& cloud = result.cloud;
    cloud.frame = box.center();
    const auto any = [&](bool (FilePoints::*has)() const) {
        return std::any_of(inputs.begin(), inputs.end(),
                           [&](const FilePoints& input) { return (input.*has)(); });
    };
    resizeLarge(cloud.positions, points);
    if (any(&FilePoints::hasNormals)) resizeLarge(cloud.normals, points);
    if (any(&FilePoints::hasConfidence)) resizeLarge(cloud.confidence, points);
    if (any(&FilePoints::hasColors)) resizeLarge(cloud.colors, points);
    for (const std::string& name : scalars)
        cloud.scalars.push_back({name, std::vector<float>(points)});
    if (any(&FilePoints::hasViewpoints)) resizeLarge(cloud.seenFrom, points);
    for (const FilePoints& input : inputs)
        for (const PointBlock& block : input.blocks)
            if (block.seenFrom) cloud.viewpoints.push_back(*block.seenFrom);
    placeBlocks(inputs, cloud, progress);
    if (inputs.size() == 1) cloud.mesh = std::move(inputs.front().mesh);
    inputs.clear();
#ifdef __GLIBC__
    // The blocks were scattered in the heap, which would keep their pages.
    if (points > kTrimPoints) malloc_trim(0);
#endif
    const std::uint64_t duplicates = dropDuplicates(cloud, progress);
    if (duplicates > 0) result.dropped["duplicate"] = duplicates;
    return result;
}

} // namespace mpuvdb
