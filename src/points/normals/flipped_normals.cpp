// Normals that look the wrong way. A screen finds the cells of a grid whose normals disagree: there
// each point asks its neighbors. Whole patches, whose points agree, are looked for after that.
#include "core/parallel_each.h"
#include "flipped_patches.h"
#include "points/indexed.h"
#include "spatial/point_cells.h"

#include <mpuvdb/interrupter.h>
#include <mpuvdb/normals.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>

namespace mpuvdb
{
namespace
{

constexpr double kCellSpacings = 5; // [tuned: clean_points_test]
/// The distance of voters, spacings; no more than a cell. [tuned: clean_points_test]
constexpr double kReachSpacings = 3;
constexpr std::size_t kFlipGrain = 256; // cells; [free: the same normals]
/// The share of flipped normals from which on voters may be wrong. [tuned: clean_points_test]
constexpr double kMany = 0.015;

/// Single flipped normals: those that most neighbors in their plane look away from.
class Vote
{
public:
    Vote(const PointCells& cells, const PointStatistics& statistics, TurnedNormals& normals)
        : mCells(cells), mNormals(normals), mReach(float(kReachSpacings * statistics.spacing)),
          mNoise(float(statistics.noise))
    {
    }

    /// @return whether many were turned.
    bool run(Interrupter& progress)
    {
        const std::vector<std::uint32_t> mixed = mixedCells(progress);
        const std::size_t turned = turnOutvoted(mixed, kClear, progress);
        // Where many are flipped, fewer voters are right.
        const bool many = double(turned) > kMany * double(mCells.index().size());
        if (many) turnOutvoted(mixed, kHardly, progress);
        return many;
    }

private:
    /// The balance of votes, as a part of them, from which on a normal is turned. [tuned:
    /// clean_points_test; on a thin part voters of the other side are in the majority now and then,
    /// but not clearly]
    static constexpr float kClear = -0.5f, kHardly = -0.35f;

    /// Rounds until none is turned: where every fifth is flipped, some are not outvoted at first.
    /// @return how often one was turned.
    std::size_t turnOutvoted(const std::vector<std::uint32_t>& cells, float against,
                             Interrupter& progress)
    {
        constexpr int kRounds = 8; // [tuned: clean_points_test]
        std::size_t turned = 0;
        std::vector<std::uint32_t> asked = cells;
        for (int round = 0; round < kRounds && !asked.empty(); ++round) {
            const auto outvoted = gatherParallel<PointInCell>(
                asked.size(), kFlipGrain, progress,
                [&](std::size_t n, auto& found) { ask(asked[n], against, found); });
            turned += outvoted.size();
            for (const PointInCell& found : outvoted) mNormals.turn(found.point);
            const std::vector<char> isAbout = cellsAbout(mCells, outvoted);
            asked.clear();
            std::copy_if(cells.begin(), cells.end(), std::back_inserter(asked),
                         [&](std::uint32_t c) { return isAbout[c]; });
        }
        return turned;
    }

    /// Cells with normals that look opposite ways.
    std::vector<std::uint32_t> mixedCells(Interrupter& progress) const
    {
        const auto findMixed = [&](std::size_t c, std::vector<std::uint32_t>& mixed) {
            if (isMixed(mCells.cells()[c])) mixed.push_back(std::uint32_t(c));
        };
        return gatherParallel<std::uint32_t>(mCells.cells().size(), kFlipGrain, progress,
                                             findMixed);
    }

    bool isMixed(const PointCells::Cell& cell) const
    {
        // The cosine from which on normals are along each other; others are across. [tuned:
        // clean_points_test]
        constexpr float kAlong = 0.5f;
        // [derived: no two are 120 degrees apart where all are within 60 of one, less rounding]
        constexpr float kAlike = 0.5001f;
        const std::vector<std::uint32_t>& order = mCells.index().order();
        const Vec3f one = mNormals.normal(order[mCells.begin(cell)->begin]);
        bool alike = true;
        mCells.forEachPoint(
            cell, [&](std::uint32_t n) { alike &= one.dot(mNormals.normal(order[n])) > kAlike; });
        if (alike) return false;
        constexpr std::size_t kFaces = 3; // [derived: of a corner]
        std::array<Vec3f, kFaces> faces;  // normals across each other, as at a corner
        std::size_t known = 0;
        for (const std::uint32_t n : mCells.byPosition(cell)) {
            const Vec3f normal = mNormals.normal(order[n]);
            std::size_t f = 0;
            for (; f < known; ++f) {
                const float cosine = faces[f].dot(normal);
                if (cosine < -kAlong) return true;
                if (cosine > kAlong) break;
            }
            if (f == known && known < kFaces) faces[known++] = normal;
        }
        return false;
    }

    struct Voter {
        Vec3f position;
        std::uint32_t point;
    };

    void ask(std::uint32_t c, float against, std::vector<PointInCell>& outvoted) const
    {
        const PointCells::Cell& cell = mCells.cells()[c];
        std::vector<Voter> around;
        const auto add = [&](const PointCells::Cell& from) {
            mCells.forEachPoint(from, [&](std::uint32_t n) {
                around.push_back({mCells.index()[n], mCells.index().order()[n]});
            });
        };
        add(cell);
        mCells.forEachAround(cell, [&](std::uint32_t n) { add(mCells.cells()[n]); });
        for (std::size_t n = 0; n < cell.size(); ++n)
            if (isOutvoted(around[n], around, against)) outvoted.push_back({around[n].point, c});
    }

    bool isOutvoted(const Voter& judged, const std::vector<Voter>& around, float against) const
    {
        constexpr float kFewest = 5; // votes; [tuned: clean_points_test]
        const Vec3f normal = mNormals.normal(judged.point);
        float votes = 0, voters = 0;
        for (const auto& [position, q] : around) {
            const Vec3f apart = position - judged.position;
            if (apart.squaredNorm() > mReach * mReach || !liesInPlane(apart, normal, mNoise))
                continue;
            if (q == judged.point) continue;
            // One across an edge has nothing to say.
            const float vote = normal.dot(mNormals.normal(q));
            votes += vote;
            voters += std::abs(vote);
        }
        return voters >= kFewest && votes < against * voters;
    }

    const PointCells& mCells;
    TurnedNormals& mNormals;
    float mReach;
    float mNoise;
};

} // namespace

double sideForFlipped(const PointStatistics& statistics)
{
    return kCellSpacings * statistics.spacing;
}

std::vector<std::uint32_t> findFlippedNormals(const PointCloud& cloud, const PointCells& cells,
                                              const PointStatistics& statistics,
                                              Interrupter& progress)
{
    std::vector<std::uint32_t> flipped;
    TurnedNormals normals(cloud);
    const bool many = Vote(cells, statistics, normals).run(progress);
    turnFlippedPatches(cells, statistics.noise, many, normals, progress);
    for (std::uint32_t i = 0; i < cloud.size(); ++i)
        if (normals.turned(i)) flipped.push_back(i);
    return flipped;
}

std::vector<std::uint32_t> findFlippedNormals(const PointCloud& cloud,
                                              const PointStatistics& statistics,
                                              Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    if (cloud.empty() || !cloud.hasNormals()) return {};
    const std::shared_ptr<const PointIndex> index = indexOf(cloud, progress);
    const PointCells cells(*index, sideForFlipped(statistics), progress);
    return findFlippedNormals(cloud, cells, statistics, progress);
}

void flipNormals(PointCloud& cloud, const std::vector<std::uint32_t>& indices)
{
    for (const std::uint32_t i : indices) cloud.normals[i] = -cloud.normals[i];
}

} // namespace mpuvdb
