#include "run_estimate.h"

#include "memory_limit.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace mpuvdb::command
{
namespace
{

/// The resident memory of libraries and of threads' scratch, bytes. [tuned: measured]
constexpr std::uint64_t kWorkingBytes = 12 << 20;
/// The bytes of the .vdb file per active voxel, and those of its coverage. [tuned: measured]
constexpr double kFileBytes = 4.6, kCoverageFileBytes = 1.15;
/// The triangles per voxel's face of surface, and their working memory, bytes. [tuned: measured]
constexpr double kTriangles = 2.96, kMeshBytes = 218;
/// The bytes of coverage per point, while it is made and after. [tuned: measured]
constexpr std::uint64_t kCoveragePointBytes = 56, kCoverageKeptBytes = 12;

double squaresOf(const ReconstructionEstimate& work)
{
    const double h = work.settings.grid.lattice.voxelSize;
    return work.area / (h * h);
}

} // namespace

RunEstimate RunEstimator::estimate(const ReconstructSettings& settings,
                                   Interrupter* interrupter) const
{
    Interrupter& progress = orSilent(interrupter);
    RunEstimate run;
    run.work = mpuvdb::estimate(mCloud, settings, &progress);
    const std::uint64_t grid = run.work.gridBytes, points = mCloud.size();
    std::uint64_t held = run.work.fit.bytes + grid, peak = run.work.peakBytes;
    run.fileBytes = std::uint64_t(kFileBytes * double(run.work.activeVoxels));
    if (mExtras.coverage) {
        peak = std::max(peak, held + std::max(kCoveragePointBytes * points,
                                              kCoverageKeptBytes * points + grid));
        held += grid;
        run.fileBytes += std::uint64_t(kCoverageFileBytes * double(run.work.activeVoxels));
    }
    if (mExtras.mesh) {
        run.triangles = std::uint64_t(kTriangles * squaresOf(run.work));
        peak = std::max(peak, held + std::uint64_t(kMeshBytes * squaresOf(run.work)));
    }
    run.peakBytes = mBareBytes + kWorkingBytes + peak;
    return run;
}

void RunEstimator::demand(std::uint64_t maxBytes, Interrupter& progress) const
{
    const ResolvedSettings resolved = resolve(mCloud, mSettings, &progress);
    // By the points' number and spacing alone; holes and uneven sampling take more.
    constexpr double kSafety = 6, kPointBytes = 200, kSquareBytes = 400;
    const double squares = double(mCloud.size()) * resolved.points.areaPerPoint() /
                           std::pow(resolved.grid.lattice.voxelSize, 2) * resolved.grid.halfWidth /
                           3;
    const double guess = double(mCloud.size()) * kPointBytes + squares * kSquareBytes;
    if (double(mBareBytes + kWorkingBytes) + kSafety * guess < double(maxBytes)) return;
    const RunEstimate run = estimate(&progress);
    if (run.peakBytes <= maxBytes) return;
    const std::optional<double> fitting = fittingVoxelSize(run, maxBytes, progress);
    throw LimitError(fmt::format(
        "voxels of size {:.4g} would take about {} of memory, and the limit is {}: {}",
        resolved.grid.lattice.voxelSize, sizeText(run.peakBytes), sizeText(maxBytes),
        fitting ? fmt::format("--voxel-size {:.3g} would fit, or raise --max-memory", *fitting)
                : "no voxel size makes so many points fit; raise --max-memory"));
}

std::optional<double> RunEstimator::fittingVoxelSize(const RunEstimate& tooLarge,
                                                     std::uint64_t maxBytes,
                                                     Interrupter& progress) const
{
    constexpr double kRoom = 0.95;   // part of the limit that an estimate may take
    constexpr double kMinVoxels = 8; // along the longest side
    ReconstructSettings settings = mSettings;
    settings.voxels.reset();
    const ResolvedSettings& resolved = tooLarge.work.settings;
    double h = resolved.grid.lattice.voxelSize;
    for (double need = double(tooLarge.peakBytes); need > kRoom * double(maxBytes);) {
        h *= std::clamp(std::sqrt(need / (kRoom * double(maxBytes))), 1.05, 4.0);
        const double digit = std::pow(10, std::floor(std::log10(h)) - 2);
        h = std::ceil(h / digit) * digit; // rounded as it is printed
        if (h * kMinVoxels > resolved.boxSize.maxCoeff()) return {};
        settings.voxelSize = Length{h, Length::Unit::World};
        need = double(estimate(settings, &progress).peakBytes);
    }
    return h;
}

} // namespace mpuvdb::command
