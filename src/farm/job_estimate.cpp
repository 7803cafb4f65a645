#include <mpuvdb/error.h>
#include <mpuvdb/farm.h>
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

/// How the points lie in tiles.
struct Spread {
    std::size_t tiles = 0; ///< that hold points
    double largest = 0;    ///< share of the points in the fullest one
};

Spread spreadOf(const PointCloud& cloud, const Lattice& lattice, int edge)
{
    const Vec3d origin = lattice.origin - cloud.frame;
    const double size = edge * lattice.voxelSize;
    const auto tileOf = [&](const Vec3f& p) {
        const Vec3i at = ((p.cast<double>() - origin) / size).array().floor().cast<int>();
        return std::array<int, 3>{at[0], at[1], at[2]};
    };
    std::map<std::array<int, 3>, std::uint64_t> counts;
    auto tile = counts.end(); // of the last point: points are near each other
    for (const Vec3f& p : cloud.positions) {
        const std::array<int, 3> at = tileOf(p);
        if (tile == counts.end() || tile->first != at) tile = counts.try_emplace(at, 0).first;
        ++tile->second;
    }
    std::uint64_t most = 0;
    for (const auto& [at, points] : counts) most = std::max(most, points);
    return {counts.size(), double(most) / double(std::max<std::size_t>(cloud.size(), 1))};
}

} // namespace

JobEstimate estimateJob(const PreparedPoints& points, const ReconstructionEstimate& run,
                        std::optional<int> tileVoxels, std::uint64_t taskBytes)
{
    const double count = double(points.cloud.size());
    const std::uint64_t pointBytes = // as they are kept
        points.cloud.size() * (7 * sizeof(float) + sizeof(std::uint64_t));
    const std::uint64_t treeBytes = run.fit.bytes - std::min(run.fit.bytes, pointBytes);
    const double room = kRoom * double(taskBytes);
    JobEstimate job;
    double wider = 1; // the surface that a tile samples, by its own
    for (int edge = tileVoxels.value_or(kLargestTile);; edge /= 2) {
        const Spread spread = spreadOf(points.cloud, run.settings.grid.lattice, edge);
        wider = std::pow((edge + 2 * kMargin) / edge, 2);
        job.tileVoxels = edge;
        job.tiles = spread.tiles;
        const double share = std::min(1.0, spread.largest * wider);
        job.taskBytes = kWorkingBytes + std::uint64_t(share * double(run.bandBytes));
        if (tileVoxels || edge == kSmallestTile || taskBytes == 0 || double(job.taskBytes) < room)
            break;
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
