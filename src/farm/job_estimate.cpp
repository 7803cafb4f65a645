#include <mpuvdb/error.h>
#include <mpuvdb/farm.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/memory.h>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

namespace mpuvdb
{
namespace
{

/// Voxels about a tile that are sampled with it. [derived: leaves beside it that hold the band and
/// the stencils of its surface, and the margin of a region]
constexpr double kMargin = 43;
/// Share of a task's memory that a tile may be estimated to take. [derived: an estimate is right to
/// a factor of two where the surface is unevenly crowded]
constexpr double kRoom = 0.5;
/// Memory of the libraries and of the threads' stacks, bytes. [derived: as of the program itself]
constexpr std::uint64_t kWorkingBytes = 32 << 20;
/// Memory of a merge, by that of the grid in memory. [derived: a leaf's masks and its place in the
/// tree and in a table, some 170 bytes, of a leaf's 2200; twice while the tree is made of the
/// table]
constexpr double kMergeShare = 0.16;
constexpr int kLargestTile = 512, kSmallestTile = 128; ///< edges, voxels [free: the same result]

/// Points by the tile that they lie in.
using Counts = std::map<std::array<int, 3>, std::uint64_t>;

/// Of tiles of @a edge voxels. @throws Interrupted.
Counts countInTiles(const PointCloud& cloud, const Lattice& lattice, int edge,
                    const Interrupter& progress)
{
    constexpr std::size_t kChunk = std::size_t(1) << 16; // points; [free: time until a stop]
    const Vec3d origin = lattice.origin - cloud.frame;
    const double size = edge * lattice.voxelSize;
    Counts counts;
    auto tile = counts.end(); // of the last point: points are near each other
    for (std::size_t n = 0; n < cloud.size(); ++n) {
        if (n % kChunk == 0) progress.check();
        const Vec3d place = (cloud.positions[n].cast<double>() - origin) / size;
        const Vec3i at = place.array().floor().cast<int>();
        const std::array<int, 3> key{at[0], at[1], at[2]};
        if (tile == counts.end() || tile->first != key) tile = counts.try_emplace(key, 0).first;
        ++tile->second;
    }
    return counts;
}

/// The same of tiles twice as large.
Counts joined(const Counts& counts)
{
    Counts result;
    for (const auto& [at, points] : counts) result[{at[0] >> 1, at[1] >> 1, at[2] >> 1}] += points;
    return result;
}

/// The share of all points that the fullest tile holds.
double largestShare(const Counts& counts, double points)
{
    std::uint64_t most = 0;
    for (const auto& [at, inTile] : counts) most = std::max(most, inTile);
    return double(most) / points;
}

} // namespace

JobEstimate estimateJob(const PreparedPoints& points, const ReconstructionEstimate& run,
                        std::optional<int> tileVoxels, std::uint64_t taskBytes,
                        Interrupter* interrupter)
{
    const double count = double(points.cloud.size());
    const std::uint64_t pointBytes = // as they are kept
        points.cloud.size() * (7 * sizeof(float) + sizeof(std::uint64_t));
    const std::uint64_t treeBytes = run.fit.bytes - std::min(run.fit.bytes, pointBytes);
    const double room = kRoom * double(taskBytes);
    // From small tiles to large ones: the last that fits, but the first in any case.
    JobEstimate job;
    double wider = 1; // the surface that a tile samples, by its own
    int edge = tileVoxels.value_or(kSmallestTile);
    Counts counts =
        countInTiles(points.cloud, run.settings.grid.lattice, edge, orSilent(interrupter));
    for (bool isFirst = true;; isFirst = false, edge *= 2, counts = joined(counts)) {
        const double ratio = std::pow((edge + 2 * kMargin) / edge, 2);
        const double share = std::min(1.0, ratio * largestShare(counts, count));
        const std::uint64_t bytes = kWorkingBytes + std::uint64_t(share * double(run.bandBytes));
        if (!isFirst && taskBytes != 0 && double(bytes) >= room) break;
        wider = ratio;
        job.tileVoxels = edge;
        job.tiles = counts.size();
        job.taskBytes = bytes;
        if (tileVoxels || edge == kLargestTile) break;
    }
    const double pointTreeBytes = 2 * double(treeBytes) / count; // twice the tree while it is built
    job.partPoints = JobOptions().partPoints;
    if (taskBytes != 0 && pointTreeBytes > 0)
        job.partPoints = std::min(job.partPoints, std::size_t(room / pointTreeBytes) + 1);
    const double partBytes = pointTreeBytes * std::min(count, double(job.partPoints));
    job.taskBytes = std::max(job.taskBytes, kWorkingBytes + std::uint64_t(partBytes));
    job.mergeBytes = kWorkingBytes + std::uint64_t(kMergeShare * double(run.gridBytes));
    if (taskBytes != 0 && job.taskBytes > taskBytes)
        throw LimitError(fmt::format(
            "a tile of {} voxels would take about {} of memory, and the limit is {}: raise "
            "--max-memory, or use {}",
            job.tileVoxels, sizeText(job.taskBytes), sizeText(taskBytes),
            job.tileVoxels > kSmallestTile ? "smaller tiles" : "larger voxels"));
    job.cpuSeconds = run.fitSeconds + wider * run.sampleSeconds;
    job.diskBytes = pointBytes + 2 * treeBytes + 2 * run.fileBytes;
    return job;
}

} // namespace mpuvdb
