// Outliers. A screen on a grid of cells a few spacings wide settles nearly all points; what is left
// in small groups of cells, or has little company, is compared with its neighbours.
#include "cell_grid.h"
#include "kd_tree.h"
#include "local_plane.h"
#include "lone_points.h"
#include "parallel_each.h"

#include <mpuvdb/outliers.h>
#include <mpuvdb/progress.h>
#include <mpuvdb/union_find.h>

#include <algorithm>
#include <cmath>
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

/// The grid's cells, joined where they share a face. A nearly empty cell joins no others: outliers
/// would hang together, and on surfaces.
class CellGroups
{
public:
    CellGroups(const CellGrid& grid, Progress& progress) : mGrid(grid), mGroups(grid.cells().size())
    {
        const auto& cells = grid.cells();
        using Pair = std::pair<std::uint32_t, std::uint32_t>;
        const auto findPairs = [&](std::size_t c, std::vector<Pair>& pairs) {
            if (cells[c].size() <= kSparse) return;
            grid.forFacesAfter(cells[c], [&](std::uint32_t other) {
                if (cells[other].size() > kSparse) pairs.push_back({std::uint32_t(c), other});
            });
        };
        for (const auto& [a, b] : gatherParallel<Pair>(cells.size(), kGrain, progress, findPairs))
            mGroups.join(a, b);
        mPoints.assign(cells.size(), 0);
        for (std::uint32_t c = 0; c < cells.size(); ++c)
            mPoints[mGroups.find(c)] += cells[c].size();
    }

    /// Whether it is neither part of a surface nor, being nearly empty, beside one.
    bool isApart(std::uint32_t c)
    {
        if (isSurface(c)) return false;
        const CellGrid::Cell& cell = mGrid.cells()[c];
        bool beside = false;
        if (cell.size() <= kSparse)
            mGrid.forEachAround(cell, [&](std::uint32_t n) { beside = beside || isSurface(n); });
        return !beside;
    }
    bool isSurface(std::uint32_t cell) { return mPoints[mGroups.find(cell)] >= kObject; }

private:
    const CellGrid& mGrid;
    UnionFind mGroups;
    std::vector<std::uint32_t> mPoints; // by root
};

/// Points of groups too small to be surfaces at the cells' scale, among each other and points that
/// stand for the surfaces' cells. Sparse surfaces are such groups, and so are outliers.
class SparsePoints
{
public:
    /// @param positions  those in doubt, then those that stand for surfaces.
    SparsePoints(const std::vector<Vec3f>& positions, std::size_t doubtful, Progress& progress)
        : mPositions(positions), mDoubtful(doubtful), mProgress(progress)
    {
        findNeighbors();
        findPlanar();
    }

    /// Whether each of the doubtful is an outlier.
    std::vector<char> outliers() const
    {
        std::vector<char> result(mDoubtful, 0);
        for (std::size_t i = 0; i < mDoubtful; ++i) result[i] = !isSupported(i);
        dropClumps(result);
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
        // Of those that stand for surfaces, the neighbours of the doubtful.
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

    /// Points that lie with their neighbours on a plane, and no farther from them than these are
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

    /// Whether its neighbours are about as far from theirs as it is from them.
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
        constexpr float kTouch = 3; // distances to the third neighbour
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
    Progress& mProgress;
    /// reachable() for each doubtful position and each beside one, nearest first
    std::vector<std::uint32_t> mNeighbors;
    std::vector<float> mDistances;
    std::vector<char> mPlanar;
};

/// The position of a cell's point nearest to its centre.
Vec3f representative(const CellGrid& grid, const CellGrid::Cell& cell)
{
    const Vec3f centre = grid.centre(cell).cast<float>();
    Vec3f best = grid.positions()[cell.begin]; // the first of those equally near: they are sorted
    for (std::uint32_t k = cell.begin + 1; k < cell.end; ++k) {
        const Vec3f& p = grid.positions()[k];
        if ((p - centre).squaredNorm() < (best - centre).squaredNorm()) best = p;
    }
    return best;
}

/// One look at all positions.
class Screen
{
public:
    /// @param normals  of the positions; or none.
    Screen(const std::vector<Vec3f>& positions, const std::vector<Vec3f>& normals,
           const PointStatistics& statistics, Progress& progress)
        : mPositions(positions), mNormals(normals), mStatistics(statistics), mProgress(progress),
          mGrid(positions,
                std::max(kCellSpacings * statistics.spacing, kCellNoises * statistics.noise),
                progress),
          mOutlier(positions.size(), 0)
    {
        CellGroups groups(mGrid, progress);
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
        judgeApart();
        flagLonePoints(mPositions, mNormals, mGrid, mStatistics, mOutlier, mProgress);
        return mOutlier;
    }

private:
    void judgeApart()
    {
        if (mApart.empty()) return;
        std::vector<Vec3f> positions(mApart.size() + mSurface.size());
        std::transform(mApart.begin(), mApart.end(), positions.begin(),
                       [&](std::uint32_t i) { return mPositions[i]; });
        forEachParallel(mSurface.size(), kGrain, mProgress, [&](std::size_t n) {
            positions[mApart.size() + n] = representative(mGrid, mGrid.cells()[mSurface[n]]);
        });
        const std::vector<char> found =
            SparsePoints(positions, mApart.size(), mProgress).outliers();
        for (std::size_t n = 0; n < mApart.size(); ++n) mOutlier[mApart[n]] = found[n];
    }

    const std::vector<Vec3f>& mPositions;
    const std::vector<Vec3f>& mNormals;
    const PointStatistics& mStatistics;
    Progress& mProgress;
    CellGrid mGrid;
    std::vector<std::uint32_t> mApart;   // points
    std::vector<std::uint32_t> mSurface; // cells
    std::vector<char> mOutlier;
};

} // namespace

std::vector<std::uint32_t> findOutliers(const PointCloud& cloud, const PointStatistics& statistics,
                                        Progress& progress)
{
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
