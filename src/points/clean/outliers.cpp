// Outliers. A screen on a grid of cells a few spacings wide settles nearly all points; what is left
// in small groups of cells, or has little company, is compared with its neighbors. What is sparser
// than the cells are wide is screened again, by its own spacing.
#include "core/parallel_each.h"
#include "local_plane.h"
#include "lone_points.h"
#include "spatial/cell_grid.h"
#include "spatial/kd_tree.h"

#include "core/union_find.h"
#include <mpuvdb/interrupter.h>
#include <mpuvdb/outliers.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

namespace mpuvdb
{
namespace
{

constexpr std::size_t kFewestPoints = 200; // of a cloud that outliers are looked for in
constexpr std::uint32_t kObject = 100;     // points of a group that is a surface without a look
constexpr std::uint32_t kClump = 24;       // points below which a group is no surface
constexpr std::uint32_t kSparse = 4;       // points of a cell up to which it joins no group
constexpr double kCellSpacings = 5;        // a gap that a surface may have
constexpr double kCellNoises = 4;          // standard deviations that a cell's width is at least
constexpr std::size_t kGrain = 256;        // cells or points

/// Edge of the cells in which points of this spacing and noise are looked at, world units.
double cellSide(const PointStatistics& statistics)
{
    return std::max(kCellSpacings * statistics.spacing, kCellNoises * statistics.noise);
}

/// The grid's cells, joined where they share a face. A nearly empty cell joins no others: outliers
/// would hang together, and on surfaces.
class CellGroups
{
public:
    /// @param weights  of the cells: how many points count in each.
    CellGroups(const CellGrid& grid, std::vector<std::uint32_t>&& weights, Interrupter& progress)
        : mGrid(grid), mWeights(std::move(weights)), mGroups(grid.cells().size())
    {
        const auto& cells = grid.cells();
        using Pair = std::pair<std::uint32_t, std::uint32_t>;
        const auto findPairs = [&](std::size_t c, std::vector<Pair>& pairs) {
            if (mWeights[c] <= kSparse) return;
            grid.forFacesAfter(cells[c], [&](std::uint32_t other) {
                if (mWeights[other] > kSparse) pairs.push_back({std::uint32_t(c), other});
            });
        };
        for (const auto& [a, b] : gatherParallel<Pair>(cells.size(), kGrain, progress, findPairs))
            mGroups.join(a, b);
        mPoints.assign(cells.size(), 0);
        for (std::uint32_t c = 0; c < cells.size(); ++c) mPoints[mGroups.find(c)] += mWeights[c];
    }

    /// Whether it is neither part of a surface nor, being nearly empty, beside one.
    bool isApart(std::uint32_t c)
    {
        if (isSurface(c)) return false;
        bool beside = false;
        if (mWeights[c] <= kSparse)
            mGrid.forEachAround(mGrid.cells()[c],
                                [&](std::uint32_t n) { beside = beside || isSurface(n); });
        return !beside;
    }
    bool isSurface(std::uint32_t cell) { return mPoints[mGroups.find(cell)] >= kObject; }

private:
    const CellGrid& mGrid;
    const std::vector<std::uint32_t> mWeights;
    UnionFind mGroups;
    std::vector<std::uint32_t> mPoints; // by root
};

/// What a point's neighbors alone say of it.
struct SparsePoint {
    bool outlying = false;
    bool amongLike = false; ///< its neighbors are about as far from theirs as it is from them
    double spacing = 0;     ///< of a surface on which its neighbors would lie around it
};

/// Points of groups too small to be surfaces at the cells' scale, among each other and points that
/// stand for the surfaces' cells. Sparse surfaces are such groups, and so are outliers.
class SparsePoints
{
public:
    /// @param positions  those in doubt, then those that stand for surfaces.
    SparsePoints(const std::vector<Vec3f>& positions, std::size_t doubtful, Interrupter& progress)
        : mPositions(positions), mDoubtful(doubtful), mProgress(progress)
    {
        findNeighbors();
        findPlanar();
    }

    /// What each of the doubtful is by its neighbors.
    std::vector<SparsePoint> judge() const
    {
        std::vector<char> outlier(mDoubtful, 0);
        for (std::size_t i = 0; i < mDoubtful; ++i) outlier[i] = !isSupported(i);
        dropClumps(outlier);
        std::vector<SparsePoint> result(mDoubtful);
        // A disc that holds j neighbors has an area of j cells, each a spacing squared.
        for (std::size_t i = 0; i < mDoubtful; ++i)
            result[i] = {outlier[i] != 0, isAmongLike(i),
                         std::sqrt(M_PI / double(reachable())) * double(reach(i))};
        return result;
    }

private:
    static constexpr std::size_t kNeighbors = 10;

    std::size_t reachable() const { return std::min(kNeighbors, mPositions.size() - 1); }
    const std::uint32_t* neighbors(std::size_t i) const { return &mNeighbors[i * reachable()]; }
    float reach(std::size_t i) const { return mDistances[(i + 1) * reachable() - 1]; }
    float distance(std::size_t i, std::size_t k) const { return mDistances[i * reachable() + k]; }

    void findNeighbors()
    {
        const KdTree tree(mPositions);
        mNeighbors.resize(mPositions.size() * reachable());
        mDistances.resize(mNeighbors.size());
        std::vector<char> asked(mPositions.size(), 0);
        std::fill_n(asked.begin(), mDoubtful, char(1));
        findNeighbors(tree, asked);
        // Of those that stand for surfaces, the neighbors of the doubtful.
        std::vector<char> beside(mPositions.size(), 0);
        for (std::size_t n = 0; n < mDoubtful * reachable(); ++n)
            beside[mNeighbors[n]] = !asked[mNeighbors[n]];
        findNeighbors(tree, beside);
    }

    void findNeighbors(const KdTree& tree, const std::vector<char>& asked)
    {
        forEachParallel(mPositions.size(), kGrain, mProgress, [&](std::size_t i) {
            if (!asked[i]) return;
            std::vector<std::uint32_t> indices(reachable() + 1);
            std::vector<float> squared(indices.size());
            tree.nearest(mPositions[i], indices, squared);
            // The point is its own nearest, or as near as copies of it.
            std::size_t to = i * reachable();
            const std::size_t end = to + reachable();
            for (std::size_t k = 0; k < indices.size() && to < end; ++k) {
                if (indices[k] == i) continue;
                mDistances[to] = std::sqrt(squared[k]);
                mNeighbors[to++] = indices[k];
            }
        });
    }

    /// Points that lie with their neighbors on a plane, and no farther from them than these are
    /// from theirs.
    void findPlanar()
    {
        mPlanar.resize(mDoubtful);
        forEachParallel(mDoubtful, kGrain, mProgress,
                        [&](std::size_t i) { mPlanar[i] = isPlanar(i); });
    }

    bool isPlanar(std::size_t i) const
    {
        const std::vector<std::uint32_t> members(neighbors(i), neighbors(i) + reachable());
        return liesFlat(mPositions, i, members, double(reach(i))) && isAmongLike(i);
    }

    /// Whether its neighbors are about as far from theirs as it is from them.
    bool isAmongLike(std::size_t i) const
    {
        constexpr float kSparser = 2;
        std::vector<float> reaches;
        for (std::size_t k = 0; k < reachable(); ++k) reaches.push_back(reach(neighbors(i)[k]));
        const auto middle = reaches.begin() + std::ptrdiff_t(reaches.size() / 2);
        std::nth_element(reaches.begin(), middle, reaches.end());
        return reach(i) < kSparser * *middle;
    }

    /// Planar, or, as on an edge of a sparse solid, close to others that are.
    bool isSupported(std::size_t i) const
    {
        constexpr std::size_t kClosest = 6, kNeeded = 3;
        if (mPlanar[i]) return true;
        std::size_t planar = 0;
        for (std::size_t k = 0; k < std::min(kClosest, reachable()); ++k) {
            const std::uint32_t q = neighbors(i)[k];
            planar += q < mDoubtful && mPlanar[q];
        }
        return planar >= kNeeded && isAmongLike(i);
    }

    /// Groups of few points that touch no surface are none.
    void dropClumps(std::vector<char>& outlier) const
    {
        constexpr float kTouch = 3; // distances to the third neighbor
        constexpr std::size_t kThird = 2;
        UnionFind groups(mPositions.size());
        for (std::uint32_t i = 0; i < mDoubtful; ++i) {
            if (i % 4096 == 0) mProgress.check();
            for (std::size_t k = 0; k < reachable() && !outlier[i]; ++k) {
                const std::uint32_t q = neighbors(i)[k];
                if (q < mDoubtful && outlier[q]) continue;
                const std::size_t third = std::min(kThird, reachable() - 1);
                if (distance(i, k) <= kTouch * std::min(distance(i, third), distance(q, third)))
                    groups.join(i, q);
            }
        }
        std::vector<std::uint32_t> points(mPositions.size(), 0);
        for (std::uint32_t i = 0; i < mPositions.size(); ++i)
            points[groups.find(i)] += i < mDoubtful ? 1 : kClump;
        for (std::uint32_t i = 0; i < mDoubtful; ++i)
            if (points[groups.find(i)] < kClump) outlier[i] = 1;
    }

    const std::vector<Vec3f>& mPositions;
    const std::size_t mDoubtful;
    Interrupter& mProgress;
    /// reachable() for each doubtful position and each beside one, nearest first
    std::vector<std::uint32_t> mNeighbors;
    std::vector<float> mDistances;
    std::vector<char> mPlanar;
};

/// The cell's point nearest to its center.
std::uint32_t representative(const CellGrid& grid, const CellGrid::Cell& cell)
{
    const Vec3f center = grid.center(cell).cast<float>();
    std::uint32_t best = cell.begin; // the first of those equally near: they are sorted
    float least = std::numeric_limits<float>::max();
    for (std::uint32_t k = cell.begin; k < cell.end; ++k) {
        const float squared = (grid.positions()[k] - center).squaredNorm();
        if (!(squared < least)) continue;
        least = squared;
        best = k;
    }
    return grid.order()[best];
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
        : mCloud(cloud), mPoints(points), mProgress(progress), mVerdicts(points.size(), kNone)
    {
    }

    enum Verdict : char { kNone, kStays, kGoes }; ///< none of what is part of no surface

    /// @param statistics  of the grid that they were too sparse for.
    const std::vector<char>& judge(PointStatistics statistics)
    {
        const double size = mCloud.localBounds().sizes().maxCoeff();
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
        const CellGrid grid(mCloud.positions, cellSide(statistics), mProgress);
        const std::vector<Tally> tallies = tally(grid, statistics.spacing);
        std::vector<std::uint32_t> weights;
        for (const Tally& t : tallies) weights.push_back(t.weight());
        CellGroups groups(grid, std::move(weights), mProgress);
        std::vector<std::uint32_t> asked;
        for (std::uint32_t c = 0; c < tallies.size(); ++c) {
            const bool isCrowd = !groups.isSurface(c) && tallies[c].waiting() > kSparse;
            if (tallies[c].waiting() > 0 && !isCrowd && !groups.isApart(c)) asked.push_back(c);
        }
        if (asked.empty()) return 0;
        std::vector<char> flags(mCloud.size(), 0);
        std::size_t judged = 0;
        flagLonePoints(mCloud.positions, mCloud.normals, grid, asked, statistics, flags, mProgress);
        for (const std::uint32_t c : asked)
            for (std::uint32_t k = grid.cells()[c].begin; k < grid.cells()[c].end; ++k) {
                const std::uint32_t i = grid.order()[k];
                const bool inSurface = groups.isSurface(c);
                if (!waits(i, statistics.spacing) || (mPoints[i].outlying && !inSurface)) continue;
                judged += !mPoints[i].outlying;
                mVerdicts[i] = flags[i] ? kGoes : kStays;
            }
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

    std::vector<Tally> tally(const CellGrid& grid, double spacing) const
    {
        std::vector<Tally> tallies(grid.cells().size());
        for (std::size_t c = 0; c < tallies.size(); ++c)
            for (std::uint32_t k = grid.cells()[c].begin; k < grid.cells()[c].end; ++k) {
                const std::uint32_t i = grid.order()[k];
                if (waits(i, spacing))
                    ++(mPoints[i].outlying ? tallies[c].outlying : tallies[c].planar);
                else if (i < mVerdicts.size() && mVerdicts[i] == kStays)
                    ++tallies[c].stays;
            }
        return tallies;
    }

    const PointCloud& mCloud;
    const std::vector<SparsePoint>& mPoints;
    Interrupter& mProgress;
    std::vector<char> mVerdicts;
};

/// One look at all positions.
class Screen
{
public:
    /// @param normals  of the positions; or none.
    Screen(const std::vector<Vec3f>& positions, const std::vector<Vec3f>& normals,
           const PointStatistics& statistics, Interrupter& progress)
        : mPositions(positions), mNormals(normals), mStatistics(statistics), mProgress(progress),
          mGrid(positions, cellSide(statistics), progress), mOutlier(positions.size(), 0)
    {
        std::vector<std::uint32_t> sizes;
        for (const CellGrid::Cell& cell : mGrid.cells()) sizes.push_back(cell.size());
        CellGroups groups(mGrid, std::move(sizes), progress);
        for (std::uint32_t c = 0; c < mGrid.cells().size(); ++c) {
            if (groups.isSurface(c)) mSurface.push_back(c);
            if (!groups.isApart(c)) continue;
            const CellGrid::Cell& cell = mGrid.cells()[c];
            mApart.insert(mApart.end(), mGrid.order().begin() + cell.begin,
                          mGrid.order().begin() + cell.end);
        }
    }

    /// Flags of outliers.
    const std::vector<char>& judge()
    {
        const PointCloud sparse = sparsePoints();
        std::vector<SparsePoint> alone;
        if (!mApart.empty())
            alone = SparsePoints(sparse.positions, mApart.size(), mProgress).judge();
        for (std::size_t n = 0; n < mApart.size(); ++n) mOutlier[mApart[n]] = alone[n].outlying;
        std::vector<std::uint32_t> all(mGrid.cells().size());
        std::iota(all.begin(), all.end(), 0u);
        flagLonePoints(mPositions, mNormals, mGrid, all, mStatistics, mOutlier, mProgress);
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
        forEachParallel(chosen.size() - mApart.size(), kGrain, mProgress, [&](std::size_t n) {
            chosen[mApart.size() + n] = representative(mGrid, mGrid.cells()[mSurface[n]]);
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
    CellGrid mGrid;
    std::vector<std::uint32_t> mApart;   // points
    std::vector<std::uint32_t> mSurface; // cells
    std::vector<char> mOutlier;
};

} // namespace

std::vector<std::uint32_t> findOutliers(const PointCloud& cloud, const PointStatistics& statistics,
                                        Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    constexpr double kMany = 0.02; // share of outliers that may have passed for surfaces
    constexpr int kRounds = 3;
    std::vector<std::uint32_t> result, left(cloud.size());
    std::iota(left.begin(), left.end(), 0u);
    std::vector<Vec3f> positions, normals; // of those left, from the second round on
    for (int round = 0; round < kRounds && left.size() >= kFewestPoints; ++round) {
        Screen screen(round == 0 ? cloud.positions : positions,
                      round == 0 ? cloud.normals : normals, statistics, progress);
        const std::vector<char>& outlier = screen.judge();
        std::vector<std::uint32_t> staying;
        for (std::size_t n = 0; n < left.size(); ++n)
            (outlier[n] ? result : staying).push_back(left[n]);
        const bool more = double(left.size() - staying.size()) > kMany * double(left.size());
        left = std::move(staying);
        if (!more) break;
        positions.clear();
        normals.clear();
        for (const std::uint32_t i : left) positions.push_back(cloud.positions[i]);
        if (cloud.hasNormals())
            for (const std::uint32_t i : left) normals.push_back(cloud.normals[i]);
    }
    std::sort(result.begin(), result.end());
    return result;
}

void dropPoints(PointCloud& cloud, const std::vector<std::uint32_t>& indices)
{
    if (indices.empty()) return;
    std::vector<std::uint8_t> keep(cloud.size(), 1);
    for (const std::uint32_t i : indices) keep[i] = 0;
    cloud.compact(keep);
}

} // namespace mpuvdb
