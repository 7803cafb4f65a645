#include "sparse_points.h"

#include "core/parallel_each.h"
#include "core/union_find.h"
#include "local_plane.h"
#include "lone_points.h"
#include "spatial/kd_tree.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

/// The points below which a group is no surface. [tuned: clean_points_test]
constexpr std::uint32_t kClump = 24;
constexpr std::size_t kSparseGrain = 256; // points; [free: the same outliers]

class SparsePoints
{
public:
    /// @param cloud  those in doubt, then those that stand for surfaces.
    SparsePoints(const PointCloud& cloud, std::size_t doubtful, Interrupter& progress)
        : mPositions(cloud.positions), mNormals(cloud.normals), mDoubtful(doubtful),
          mProgress(progress)
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
    static constexpr std::size_t kNeighbors = 10; ///< of a point; [tuned: clean_points_test]
    /// As many times these are looked at for those of its own side. [derived: the two sides of a
    /// wall]
    static constexpr std::size_t kSides = 2;

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
        forEachParallel(mPositions.size(), kSparseGrain, mProgress, [&](std::size_t i) {
            if (!asked[i]) return;
            // The point is its own nearest, or as near as copies of it.
            const std::size_t most = reachable() * (mNormals.empty() ? 1 : kSides) + 1;
            std::vector<std::uint32_t> indices(std::min(most, mPositions.size()));
            std::vector<float> squared(indices.size());
            tree.nearest(mPositions[i], indices, squared);
            std::vector<std::size_t> chosen;
            for (const bool onSheet : {true, false})
                for (std::size_t k = 0; k < indices.size() && chosen.size() < reachable(); ++k)
                    if (indices[k] != i && mayShareSheet(i, indices[k]) == onSheet)
                        chosen.push_back(k);
            std::sort(chosen.begin(), chosen.end());
            for (std::size_t n = 0; n < chosen.size(); ++n) {
                mDistances[i * reachable() + n] = std::sqrt(squared[chosen[n]]);
                mNeighbors[i * reachable() + n] = indices[chosen[n]];
            }
        });
    }

    /// Whether a point may lie on another's sheet by their normals: not on a wall's other side.
    bool mayShareSheet(std::size_t point, std::size_t other) const
    {
        return mNormals.empty() || lookToOneSide(mNormals[point], mNormals[other]);
    }

    /// Points that lie with their neighbors on a plane, and no farther from them than these are
    /// from theirs.
    void findPlanar()
    {
        mPlanar.resize(mDoubtful);
        forEachParallel(mDoubtful, kSparseGrain, mProgress,
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
        // The ratio of its reach to the median of theirs. [tuned: clean_points_test]
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
        // The nearest neighbors that are asked, and those that have to lie on planes. [tuned:
        // clean_points_test]
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
        // The distance of points that hang together, in those to their third neighbors. [tuned:
        // clean_points_test]
        constexpr float kTouch = 3;
        constexpr std::size_t kThird = 2; // [derived: counted from 0]
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
    const std::vector<Vec3f>& mNormals; ///< or none
    const std::size_t mDoubtful;
    Interrupter& mProgress;
    /// reachable() for each doubtful position and each beside one, nearest first
    std::vector<std::uint32_t> mNeighbors;
    std::vector<float> mDistances;
    std::vector<char> mPlanar;
};

} // namespace

std::vector<SparsePoint> judgeSparsePoints(const PointCloud& cloud, std::size_t doubtful,
                                           Interrupter& progress)
{
    return SparsePoints(cloud, doubtful, progress).judge();
}

} // namespace mpuvdb
