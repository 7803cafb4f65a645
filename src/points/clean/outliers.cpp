// Outliers. A screen on a grid of cells a few spacings wide settles nearly all points; what is left
// in small groups of cells, or has few neighbors, is compared with its neighbors. What is sparser
// than the cells are wide is screened again, by its own spacing.
#include "core/parallel_each.h"
#include "lone_points.h"
#include "points/indexed.h"
#include "sparse_points.h"
#include "spatial/point_cells.h"
#include "spatial/position_order.h"

#include "core/union_find.h"
#include <mpuvdb/interrupter.h>
#include <mpuvdb/outliers.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <utility>

namespace mpuvdb
{
namespace
{

/// The fewest points of a cloud in which outliers are looked for. [tuned: clean_points_test]
constexpr std::size_t kFewestPoints = 200;
/// The points of a group of cells that is a surface without a look at its neighbors. [tuned:
/// clean_points_test]
constexpr std::uint32_t kObject = 100;
/// The points of a cell up to which it joins no group. [tuned: clean_points_test]
constexpr std::uint32_t kSparse = 4;
/// The width of a gap that a surface may have, spacings. [tuned: clean_points_test]
constexpr double kCellSpacings = 5;
/// The least width of a cell in standard deviations of the noise. [derived: points of a plane lie
/// within two to either side, all but one in twenty]
constexpr double kCellNoises = 4;
constexpr std::size_t kOutlierGrain = 256; // cells or points; [free: the same outliers]

/// The grid's cells, joined where they share a face. A nearly empty cell joins no others: outliers
/// would hang together, and on surfaces.
class CellGroups
{
public:
    /// @param weights  of the cells: how many points count in each.
    CellGroups(const PointCells& cells, std::vector<std::uint32_t>&& weights, Interrupter& progress)
        : mCells(cells), mWeights(std::move(weights)), mGroups(cells.cells().size())
    {
        using Pair = std::pair<std::uint32_t, std::uint32_t>;
        const auto findPairs = [&](std::size_t c, std::vector<Pair>& pairs) {
            if (mWeights[c] <= kSparse) return;
            cells.forFacesAfter(cells.cells()[c], [&](std::uint32_t other) {
                if (mWeights[other] > kSparse) pairs.push_back({std::uint32_t(c), other});
            });
        };
        for (const auto& [a, b] :
             gatherParallel<Pair>(mWeights.size(), kOutlierGrain, progress, findPairs))
            mGroups.join(a, b);
        mPoints.assign(mWeights.size(), 0);
        for (std::uint32_t c = 0; c < mWeights.size(); ++c) mPoints[mGroups.find(c)] += mWeights[c];
    }

    /// Whether it is neither part of a surface nor, being nearly empty, beside one.
    bool isApart(std::uint32_t c)
    {
        if (isSurface(c)) return false;
        bool beside = false;
        if (mWeights[c] <= kSparse)
            mCells.forEachAround(mCells.cells()[c],
                                 [&](std::uint32_t n) { beside = beside || isSurface(n); });
        return !beside;
    }
    bool isSurface(std::uint32_t cell) { return mPoints[mGroups.find(cell)] >= kObject; }

private:
    const PointCells& mCells;
    const std::vector<std::uint32_t> mWeights;
    UnionFind mGroups;
    std::vector<std::uint32_t> mPoints; // by root
};

/// The cell's point nearest to its center.
std::uint32_t representative(const PointCells& cells, const PointCells::Cell& cell)
{
    const PointIndex& index = cells.index();
    const Vec3f center = cells.center(cell).cast<float>();
    std::uint32_t best = cells.begin(cell)->begin;
    float least = std::numeric_limits<float>::max();
    cells.forEachPoint(cell, [&](std::uint32_t n) {
        const float squared = (index[n] - center).squaredNorm();
        if (squared > least || (squared == least && !positionBefore(index[n], index[best]))) return;
        least = squared;
        best = n;
    });
    return index.order()[best];
}

/// Points too sparse for a grid, judged on coarser ones: a part of any spacing meets one whose
/// cells are a few of its own spacings wide. There it is seen as every part of the cloud's own
/// spacing is.
class SparseParts
{
public:
    /// @param cloud  the sparse points, then those that stand for denser surfaces.
    SparseParts(const PointCloud& cloud, const std::vector<SparsePoint>& points,
                Interrupter& progress)
        : mCloud(cloud), mIndex(cloud.positions, progress), mPoints(points), mProgress(progress),
          mVerdicts(points.size(), kNone)
    {
    }

    enum Verdict : char { kNone, kStays, kGoes }; ///< none of what is part of no surface

    /// @param statistics  of the grid that they were too sparse for.
    const std::vector<char>& judge(PointStatistics statistics)
    {
        const double size = double(mIndex.bounds().sizes().maxCoeff());
        // What is left beside a part belongs to it by the next grid.
        for (bool again = false; statistics.spacing < size;) {
            statistics.spacing *= 2; // [derived: cells are then 2.5 to 5 spacings of some part]
            const std::size_t left = planarLeft(statistics.spacing);
            if (left == 0 || (left < kObject && !again)) break;
            again = judgeAt(statistics) >= kObject;
        }
        return mVerdicts;
    }

private:
    /// Whether a point waits for its grid, and this one or a coarser one may be it.
    bool waits(std::uint32_t i, double spacing) const
    {
        // [derived: half a part's spacing is the first that may be its own, the next is for what is
        // left beside; a factor 2 for how uneven the points of a part are]
        constexpr double kFinest = 0.25;
        return i < mVerdicts.size() && mVerdicts[i] == kNone && mPoints[i].amongLike &&
               mPoints[i].spacing > kFinest * spacing;
    }

    /// How many that lie on planes with their neighbors wait for their grid.
    std::size_t planarLeft(double spacing) const
    {
        std::size_t count = 0;
        for (std::uint32_t i = 0; i < mVerdicts.size(); ++i)
            count += waits(i, spacing) && !mPoints[i].outlying;
        return count;
    }

    /// @return how many that lie on planes were judged.
    std::size_t judgeAt(const PointStatistics& statistics)
    {
        const PointCells cells(mIndex, sideForOutliers(statistics), mProgress);
        const std::vector<Tally> tallies = tally(cells, statistics.spacing);
        std::vector<std::uint32_t> weights;
        weights.reserve(tallies.size());
        for (const Tally& t : tallies) weights.push_back(t.weight());
        CellGroups groups(cells, std::move(weights), mProgress);
        std::vector<std::uint32_t> asked;
        for (std::uint32_t c = 0; c < tallies.size(); ++c) {
            const bool isCrowd = !groups.isSurface(c) && tallies[c].waiting() > kSparse;
            if (tallies[c].waiting() > 0 && !isCrowd && !groups.isApart(c)) asked.push_back(c);
        }
        if (asked.empty()) return 0;
        std::vector<char> flags(mCloud.size(), 0);
        std::size_t judged = 0;
        flagLonePoints(mCloud.positions, mCloud.normals, cells, asked, statistics, flags,
                       mProgress);
        for (const std::uint32_t c : asked)
            cells.forEachPoint(cells.cells()[c], [&](std::uint32_t n) {
                const std::uint32_t i = mIndex.order()[n];
                const bool inSurface = groups.isSurface(c);
                if (!waits(i, statistics.spacing) || (mPoints[i].outlying && !inSurface)) return;
                judged += !mPoints[i].outlying;
                mVerdicts[i] = flags[i] ? kGoes : kStays;
            });
        return judged;
    }

    /// How many points of a cell are known to stay, lie on planes, and do not.
    struct Tally {
        std::uint32_t stays = 0, planar = 0, outlying = 0;

        std::uint32_t waiting() const { return planar + outlying; }
        /// How many speak for a surface. None do where most that wait lie on no planes: that is a
        /// crowd of outliers; nor where these are so many that the grid is not theirs.
        std::uint32_t weight() const
        {
            // [derived: a plane along the diagonal of a cell of 5 spacings holds 5 * 5 * sqrt(3)
            // points; three deviations more where they lie at random]
            constexpr std::uint32_t kMost = 63;
            return stays + planar > outlying && waiting() <= kMost ? stays + waiting() : 0;
        }
    };

    std::vector<Tally> tally(const PointCells& cells, double spacing) const
    {
        std::vector<Tally> tallies(cells.cells().size());
        for (std::size_t c = 0; c < tallies.size(); ++c)
            cells.forEachPoint(cells.cells()[c], [&](std::uint32_t n) {
                const std::uint32_t i = mIndex.order()[n];
                if (waits(i, spacing))
                    ++(mPoints[i].outlying ? tallies[c].outlying : tallies[c].planar);
                else if (i < mVerdicts.size() && mVerdicts[i] == kStays)
                    ++tallies[c].stays;
            });
        return tallies;
    }

    const PointCloud& mCloud;
    const PointIndex mIndex;
    const std::vector<SparsePoint>& mPoints;
    Interrupter& mProgress;
    std::vector<char> mVerdicts;
};

/// One look at all positions.
class Screen
{
public:
    /// @param cells  of the points of @a cloud that are looked at.
    Screen(const PointCloud& cloud, const PointCells& cells, const PointStatistics& statistics,
           Interrupter& progress)
        : mPositions(cloud.positions), mNormals(cloud.normals), mStatistics(statistics),
          mProgress(progress), mCells(cells), mOutlier(cloud.size(), 0)
    {
        std::vector<std::uint32_t> sizes;
        for (const PointCells::Cell& cell : mCells.cells()) sizes.push_back(cell.size());
        CellGroups groups(mCells, std::move(sizes), progress);
        for (std::uint32_t c = 0; c < mCells.cells().size(); ++c) {
            if (groups.isSurface(c)) mSurface.push_back(c);
            if (!groups.isApart(c)) continue;
            mCells.forEachPoint(mCells.cells()[c], [&](std::uint32_t n) {
                mApart.push_back(mCells.index().order()[n]);
            });
        }
    }

    /// Flags of outliers.
    const std::vector<char>& judge()
    {
        const PointCloud sparse = sparsePoints();
        std::vector<SparsePoint> alone;
        if (!mApart.empty()) alone = judgeSparsePoints(sparse, mApart.size(), mProgress);
        for (std::size_t n = 0; n < mApart.size(); ++n) mOutlier[mApart[n]] = alone[n].outlying;
        std::vector<std::uint32_t> all(mCells.cells().size());
        std::iota(all.begin(), all.end(), 0u);
        flagLonePoints(mPositions, mNormals, mCells, all, mStatistics, mOutlier, mProgress);
        const std::vector<char> verdicts = SparseParts(sparse, alone, mProgress).judge(mStatistics);
        for (std::size_t n = 0; n < mApart.size(); ++n)
            if (verdicts[n] != SparseParts::kNone)
                mOutlier[mApart[n]] = verdicts[n] == SparseParts::kGoes;
        return mOutlier;
    }

private:
    /// Those apart, and one for each of the surfaces' cells.
    PointCloud sparsePoints()
    {
        std::vector<std::uint32_t> chosen(mApart.empty() ? 0 : mApart.size() + mSurface.size());
        std::copy(mApart.begin(), mApart.end(), chosen.begin());
        forEachParallel(
            chosen.size() - mApart.size(), kOutlierGrain, mProgress, [&](std::size_t n) {
                chosen[mApart.size() + n] = representative(mCells, mCells.cells()[mSurface[n]]);
            });
        PointCloud sparse;
        for (const std::uint32_t i : chosen) sparse.positions.push_back(mPositions[i]);
        if (!mNormals.empty())
            for (const std::uint32_t i : chosen) sparse.normals.push_back(mNormals[i]);
        return sparse;
    }

    const std::vector<Vec3f>& mPositions;
    const std::vector<Vec3f>& mNormals;
    const PointStatistics& mStatistics;
    Interrupter& mProgress;
    const PointCells& mCells;
    std::vector<std::uint32_t> mApart;   // points
    std::vector<std::uint32_t> mSurface; // cells
    std::vector<char> mOutlier;
};

} // namespace

double sideForOutliers(const PointStatistics& statistics)
{
    return std::max(kCellSpacings * statistics.spacing, kCellNoises * statistics.noise);
}

std::vector<std::uint32_t> findOutliers(const PointCloud& cloud, const PointCells& all,
                                        const PointStatistics& statistics, Interrupter& progress)
{
    // The share of outliers from which on others may pass for surfaces. [tuned: clean_points_test]
    constexpr double kMany = 0.02;
    constexpr int kRounds = 3; // [tuned: clean_points_test]
    std::vector<std::uint8_t> keep(cloud.size(), 1);
    std::shared_ptr<const PointIndex> index; // of those that are left
    std::optional<PointCells> cells;
    const PointCells* left = &all;
    for (int round = 0; round < kRounds && left->index().size() >= kFewestPoints; ++round) {
        Screen screen(cloud, *left, statistics, progress);
        const std::vector<char>& outlier = screen.judge();
        std::size_t found = 0;
        for (std::size_t i = 0; i < cloud.size(); ++i) {
            found += outlier[i] ? 1 : 0;
            if (outlier[i]) keep[i] = 0;
        }
        const bool more = double(found) > kMany * double(left->index().size());
        if (!more || round + 1 == kRounds) break;
        const auto rest = left->index().kept(keep, progress);
        left = &cells.emplace(*rest, sideForOutliers(statistics), progress);
        index = rest;
    }
    std::vector<std::uint32_t> result;
    for (std::uint32_t i = 0; i < cloud.size(); ++i)
        if (!keep[i]) result.push_back(i);
    return result;
}

std::vector<std::uint32_t> findOutliers(const PointCloud& cloud, const PointStatistics& statistics,
                                        Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    if (cloud.size() < kFewestPoints) return {};
    const std::shared_ptr<const PointIndex> index = indexOf(cloud, progress);
    const PointCells cells(*index, sideForOutliers(statistics), progress);
    return findOutliers(cloud, cells, statistics, progress);
}

void dropPoints(PointCloud& cloud, const std::vector<std::uint32_t>& indices)
{
    if (indices.empty()) return;
    std::vector<std::uint8_t> keep(cloud.size(), 1);
    for (const std::uint32_t i : indices) keep[i] = 0;
    cloud.compact(keep);
}

} // namespace mpuvdb
