// Estimates of a fit, from fits of the points of a few cells.
#include "core/cpu_time.h"
#include "mpu/fill/coarse_sign.h"
#include "mpu/fit/noisy_cell_fitter.h"
#include "mpu/octree/octree.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

constexpr double kTargetPoints = 1e5; ///< points to fit [tuned: estimate_test]
/// Mean points of a part, and largest level of its cell. [tuned: estimate_test]
constexpr double kPartPoints = 4096;
constexpr int kMaxPartLevel = 6;
/// Margin of points around a part, in its edges, for the balls of its cells. [tuned: estimate_test]
constexpr double kPartMargin = 0.25;

/// Bytes of a point in SortedPoints. [derived: a PointBatch's floats and the key]
constexpr std::uint64_t kPointBytes = 7 * sizeof(float) + sizeof(std::uint64_t);
/// Bytes per point while they are sorted. [derived: two arrays of keys with indices]
constexpr std::uint64_t kSortBytes = 32;
/// Bytes of freed arrays that stay with the process: per point, and at most. [tuned: estimate_test]
constexpr std::uint64_t kUnusedBytes = 20, kMaxUnusedBytes = 40 << 20;

/// The cells of one level of the octree that hold points, and which of them are fitted.
class Parts
{
public:
    /// @throws Interrupted.
    Parts(const PointCloud& cloud, const RootCube& root, const Interrupter& progress)
        : mRoot(root), mProgress(progress)
    {
        const double wanted = double(cloud.size()) / kPartPoints;
        markOccupied(cloud);
        // The coarsest level with as many cells, or the finest.
        while (mLevel > 1) {
            std::vector<State> coarser = coarserState();
            const std::size_t occupied = occupiedIn(coarser);
            if (double(occupied) < wanted) break;
            --mLevel;
            mState = std::move(coarser);
            mOccupied = occupied;
        }
        const auto step = std::clamp<std::size_t>(std::size_t(double(cloud.size()) / kTargetPoints),
                                                  1, mOccupied);
        std::size_t seen = 0;
        // In Morton order, which spreads them over the surface.
        choose({}, [&] { return seen++ % step == step / 2; });
        markAround();
    }

    /// Ratio of all occupied cells to those fitted.
    double share() const { return double(mOccupied) / double(mChosen); }

    /// The points in and around the parts that are fitted.
    PointCloud pointsOf(const PointCloud& cloud) const
    {
        PointCloud some;
        some.frame = cloud.frame;
        for (std::size_t n = 0; n < cloud.size(); ++n) {
            checkAt(n);
            if (!mIsAround[indexAt(cloud.positions[n].cast<double>())] ||
                !isNear(cloud.positions[n]))
                continue;
            some.positions.push_back(cloud.positions[n]);
            some.normals.push_back(cloud.normals[n]);
            if (!cloud.confidence.empty()) some.confidence.push_back(cloud.confidence[n]);
        }
        return some;
    }

    bool isIn(const Vec3d& p) const { return mState[indexAt(p)] == State::Fitted; }

private:
    enum class State : std::uint8_t { Empty, Occupied, Fitted };

    std::size_t index(std::uint32_t i, std::uint32_t j, std::uint32_t k) const
    {
        return (std::size_t(i) << 2 * mLevel) + (std::size_t(j) << mLevel) + k;
    }

    std::size_t indexAt(const Vec3d& p) const
    {
        const double last = std::ldexp(1.0, mLevel) - 1;
        const Vec3d q = (p - mRoot.corner) / mRoot.size(mLevel);
        const auto at = [&](int axis) { return std::uint32_t(std::clamp(q[axis], 0.0, last)); };
        return index(at(0), at(1), at(2));
    }

    void markOccupied(const PointCloud& cloud)
    {
        mState.assign(std::size_t(1) << 3 * mLevel, State::Empty);
        for (std::size_t n = 0; n < cloud.size(); ++n) {
            checkAt(n);
            mState[indexAt(cloud.positions[n].cast<double>())] = State::Occupied;
        }
        mOccupied = occupiedIn(mState);
    }

    static std::size_t occupiedIn(const std::vector<State>& state)
    {
        return std::size_t(std::count(state.begin(), state.end(), State::Occupied));
    }

    /// The cells of the level above.
    std::vector<State> coarserState() const
    {
        const int level = mLevel - 1;
        std::vector<State> coarser(std::size_t(1) << 3 * level, State::Empty);
        const std::size_t last = (std::size_t(1) << mLevel) - 1;
        for (std::size_t n = 0; n < mState.size(); ++n)
            if (mState[n] == State::Occupied) {
                const std::size_t i = n >> 2 * mLevel, j = n >> mLevel & last, k = n & last;
                coarser[(i / 2 << 2 * level) + (j / 2 << level) + k / 2] = State::Occupied;
            }
        return coarser;
    }

    void checkAt(std::size_t point) const
    {
        constexpr std::size_t kChunk = std::size_t(1) << 16; // points; [free: time until a stop]
        if (point % kChunk == 0) mProgress.check();
    }

    template <typename F>
    void choose(const OctreeCell& cell, const F& isNext)
    {
        if (cell.level < mLevel) {
            for (int octant = 0; octant < 8; ++octant) choose(cell.child(octant), isNext);
            return;
        }
        State& state = mState[index(cell.i, cell.j, cell.k)];
        if (state == State::Empty || !isNext()) return;
        state = State::Fitted;
        ++mChosen;
    }

    /// Mark the cells that are fitted, and those beside them.
    void markAround()
    {
        mIsAround.assign(mState.size(), 0);
        const int last = (1 << mLevel) - 1;
        const auto forBox = [&](const Vec3i& from, const Vec3i& to, const auto& f) {
            const Vec3i low = from.cwiseMax(0), high = to.cwiseMin(last);
            for (int i = low[0]; i <= high[0]; ++i)
                for (int j = low[1]; j <= high[1]; ++j)
                    for (int k = low[2]; k <= high[2]; ++k) f(Vec3i(i, j, k));
        };
        const auto at = [&](const Vec3i& cell) {
            return index(std::uint32_t(cell[0]), std::uint32_t(cell[1]), std::uint32_t(cell[2]));
        };
        const Vec3i one = Vec3i::Ones();
        forBox(Vec3i::Zero(), Vec3i::Constant(last), [&](const Vec3i& cell) {
            if (mState[at(cell)] == State::Fitted)
                forBox(cell - one, cell + one, [&](const Vec3i& near) { mIsAround[at(near)] = 1; });
        });
    }

    bool isNear(const Vec3f& point) const
    {
        const Vec3d p = point.cast<double>();
        const double margin = kPartMargin * mRoot.size(mLevel);
        for (int corner = 0; corner < 8; ++corner) {
            const Vec3d side(corner & 1 ? 1 : -1, corner & 2 ? 1 : -1, corner & 4 ? 1 : -1);
            if (isIn(p + margin * side)) return true;
        }
        return false;
    }

    RootCube mRoot;
    const Interrupter& mProgress;
    int mLevel = kMaxPartLevel;
    std::vector<State> mState;
    std::vector<std::uint8_t> mIsAround; ///< whether a cell or one beside it is fitted
    std::size_t mOccupied = 0, mChosen = 0;
};

} // namespace

MpuEstimate estimateFit(const PointCloud& cloud, const MpuSettings& given, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    checkSettings(cloud, given);
    MpuSettings settings = given;
    settings.sharp &= !settings.interpolate;
    const Box3d bounds = cloud.localBounds();
    const RootCube root = rootCube(bounds, settings.voxelSize);
    progress.beginStage("estimate");
    const double start = processCpuSeconds();
    const Parts parts(cloud, root, progress);
    const SortedPoints points(parts.pointsOf(cloud), root, progress);
    const double built = processCpuSeconds();
    OctreeDraft tree = buildOctree(points, root, settings, progress);
    const double ended = processCpuSeconds();
    std::uint64_t leaves = 0;
    Unseen unseen;
    unseen.voxelSize = settings.voxelSize;
    tree.forEachLeaf([&](const OctreeNode& node, const OctreeCell& cell) {
        if (!parts.isIn(root.center(cell))) return;
        ++leaves;
        if (node.support < 1) unseen.cells.push_back(cell);
    });
    progress.endStage();

    MpuEstimate estimate;
    const double share = parts.share() * double(leaves) / double(tree.statistics.leaves);
    estimate.leaves = std::uint64_t(parts.share() * double(leaves));
    estimate.cpuSeconds = built - start + share * (ended - built);
    const auto treeBytes = std::uint64_t(share * double(tree.usedBytes()));
    const std::uint64_t cloudBytes =
        cloud.size() * (2 * sizeof(Vec3f) + (cloud.confidence.empty() ? 0 : sizeof(float)));
    const std::uint64_t pointBytes = kPointBytes * cloud.size(),
                        unused = std::min(kUnusedBytes * cloud.size(), kMaxUnusedBytes);
    const std::uint64_t meanBytes =
        NoisyScan::isFor(settings) ? NoisyScan::kMeanBytes * cloud.size() : 0;
    const std::uint64_t coarseBytes =
        unseen.cells.empty()
            ? 0
            : CoarseSign::makingPeakBytes(points, bounds, root, unseen, parts.share());
    estimate.bytes = pointBytes + treeBytes + coarseBytes / 16;
    estimate.peakBytes = std::max({cloudBytes + kSortBytes * cloud.size(),
                                   pointBytes + 2 * treeBytes + meanBytes + unused,
                                   pointBytes + treeBytes + coarseBytes});
    return estimate;
}

} // namespace mpuvdb
