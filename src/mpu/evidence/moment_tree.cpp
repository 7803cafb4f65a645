#include "moment_tree.h"

#include "core/clones.h"
#include "core/lanes.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

/// Most points of a leaf. [tuned: attributes_bench; 8 takes a seventh more time, and waves of ten
/// spacings are 4 % farther; 64 is the same within 3 %]
constexpr std::uint32_t kLeafPoints = 32;
/// Points of a leaf by which its spacing is measured. [derived: the lanes of a vector]
constexpr std::uint32_t kSpacingPoints = 8;
/// Least confidence: points without any count only where there are no others. [derived: below what
/// floats resolve beside 1]
constexpr float kMinConfidence = 1e-9f;
/// Step of level 0, spacings: weights have a mean spread of 0.58 steps, those of a ball with a
/// dozen points one of 0.8 spacings. [tuned: attributes_bench; 1.2 leaves 8 % more noise, 1.4 blurs
/// 15 % more]
constexpr float kStepSpacings = 1.3f;
/// Finest level, with steps an eighth of the usual: windows of finer ones cost too much.
/// [tuned: attributes_bench, time]
constexpr int kMinLevel = -3;

/// The least squared distance from one of the @a count points from @a begin on to its third
/// neighbor among them.
MPUVDB_CLONES
float leastToThird(const PointArrays& points, std::uint32_t begin, std::uint32_t count)
{
    using Lanes = float __attribute__((vector_size(4 * kSpacingPoints)));
    Lanes at[3]{}, least[4]; // least: of each point, the distances to itself and three others
    for (std::uint32_t n = 0; n < count; ++n) {
        at[0][n] = points.x[begin + n];
        at[1][n] = points.y[begin + n];
        at[2][n] = points.z[begin + n];
    }
    for (Lanes& squared : least) squared = Lanes{} + std::numeric_limits<float>::max();
    for (std::uint32_t n = 0; n < count; ++n) {
        const Lanes x = at[0] - at[0][n], y = at[1] - at[1][n], z = at[2] - at[2][n];
        Lanes squared = x * x + (y * y + z * z);
        for (Lanes& known : least) {
            const Lanes farther = squared < known ? known : squared;
            known = squared < known ? squared : known;
            squared = farther;
        }
    }
    float result = least[3][0];
    for (std::uint32_t n = 1; n < count; ++n) result = std::min(result, least[3][n]);
    return result;
}

} // namespace

MomentTree::MomentTree(const SortedPoints& points, const Channels& channels, Interrupter& progress)
    : mPoints(points.points()), mChannels(channels), mTree(points.tree(kLeafPoints)),
      mLength((channels.size() + 4) / 4 * kLanes)
{
    for (const float* const channel : mChannels)
        mReferences.push_back(mPoints.size() > 0 ? channel[0] : 0);
    const double confidence =
        std::accumulate(mPoints.confidence, mPoints.confidence + mPoints.size(), 0.0);
    if (confidence > 0) mPerConfidence = float(double(mPoints.size()) / confidence);
    findLevels(progress);
    sumUp(progress);
}

/// Of a mean of 1.
float MomentTree::confidenceOf(std::uint32_t point) const
{
    return std::max(mPoints.confidence[point] * mPerConfidence, kMinConfidence);
}

/// @param area  that is the point's, in those of points with the median spacing.
template <bool kIsFirst>
void MomentTree::addSums(std::uint32_t point, float area, float* sums) const
{
    using Four = float __attribute__((vector_size(16)));
    const float weight = confidenceOf(point) * area;
    const auto quantity = [&](std::size_t n) {
        if (n > mChannels.size()) return 0.0f;
        return n == 0 ? weight : weight * (mChannels[n - 1][point] - mReferences[n - 1]);
    };
    for (std::size_t n = 0; n < mLength / 4; n += 4, sums += kLanes) {
        const Four four{quantity(n), quantity(n + 1), quantity(n + 2), quantity(n + 3)};
        Four moments[] = {four, four * mPoints.nx[point], four * mPoints.ny[point],
                          four * mPoints.nz[point]};
        if (!kIsFirst)
            for (std::size_t k = 0; k < 4; ++k) moments[k] += lanesAt<Four>(sums + 4 * k);
        std::memcpy(sums, moments, sizeof moments);
    }
}

void MomentTree::sumsOf(std::uint32_t point, float area, float* sums) const
{
    addSums<true>(point, area, sums);
}

BucketTree::Bucket MomentTree::bucketsOf(std::uint32_t node) const
{
    const auto& nodes = mTree.nodes();
    std::uint32_t first = node, last = node;
    while (!nodes[first].leaf) ++first;
    while (!nodes[last].leaf) last = nodes[last].second;
    return {nodes[first].second, nodes[last].second + 1};
}

BucketTree::Bucket MomentTree::pointsOf(std::uint32_t node) const
{
    const BucketTree::Bucket buckets = bucketsOf(node);
    return {mTree.buckets()[buckets.begin].begin, mTree.buckets()[buckets.end - 1].end};
}

/// The center of weight of a place's points.
Vec3f MomentTree::middleOf(const Place& place) const
{
    const BucketTree::Bucket points = pointsOf(place.node);
    Vec3f middle = position(points.begin);
    float sum = confidenceOf(points.begin);
    for (std::uint32_t n = points.begin + 1; n < points.end; ++n) {
        const float confidence = confidenceOf(n);
        sum += confidence;
        middle += confidence / sum * (position(n) - middle);
    }
    return middle;
}

/// Set the sums of a place's points.
void MomentTree::sumsOf(const Place& place, float* sums) const
{
    const BucketTree::Bucket points = pointsOf(place.node);
    const float area = areaAt(place.group);
    addSums<true>(points.begin, area, sums);
    for (std::uint32_t n = points.begin + 1; n < points.end; ++n) addSums<false>(n, area, sums);
}

/// The groups that have no others below.
std::vector<MomentTree::Place> MomentTree::lastGroups() const
{
    std::vector<Place> all;
    if (mTree.nodes().empty()) return all;
    all.push_back({});
    while (2 * all.size() < mFinest.size()) {
        std::vector<Place> below;
        below.reserve(2 * all.size());
        for (const Place& place : all)
            for (const Place& child : childrenOf(place)) below.push_back(child);
        all.swap(below);
    }
    return all;
}

void MomentTree::sumUp(Interrupter& progress)
{
    mSums.resize(mFinest.size() * mLength);
    mMiddles.resize(mFinest.size());
    const std::vector<Place> last = lastGroups();
    tbb::parallel_for(std::size_t(0), last.size(), [&](std::size_t n) {
        progress.check();
        mMiddles[last[n].group] = middleOf(last[n]);
        sumsOf(last[n], mSums.data() + last[n].group * mLength);
    });
    for (std::size_t group = mFinest.size() / 2; group-- > 1;) {
        progress.check();
        float* const sums = mSums.data() + group * mLength;
        const float *const first = mSums.data() + 2 * group * mLength, *second = first + mLength;
        for (std::size_t i = 0; i < mLength; ++i) sums[i] = first[i] + second[i];
        mMiddles[group] = mMiddles[2 * group] +
                          second[0] / sums[0] * (mMiddles[2 * group + 1] - mMiddles[2 * group]);
    }
}

/// The spacing by the distance to the third neighbor, the least in a bucket; 0 for too few points.
float MomentTree::spacingIn(const BucketTree::Bucket& bucket) const
{
    const std::uint32_t count = std::min(bucket.end - bucket.begin, kSpacingPoints);
    return count < 4 ? 0 : std::sqrt(float(M_PI) / 3 * leastToThird(mPoints, bucket.begin, count));
}

/// Set each group's finest level by the spacing about it.
void MomentTree::findLevels(Interrupter& progress)
{
    struct Spacings {
        float sum = 0;
        std::uint32_t count = 0;

        float mean() const { return sum / float(count); }
    };
    std::vector<float> all(mTree.buckets().size());
    std::size_t size = 2; // of the heap
    while (all.size() / size >= kMinGroupBuckets) size *= 2;
    mFinest.assign(size, 0);
    tbb::parallel_for(std::size_t(0), all.size(), [&](std::size_t n) {
        progress.check();
        all[n] = spacingIn(mTree.buckets()[n]);
    });
    std::vector<Spacings> spacings(size);
    for (const Place& place : lastGroups()) {
        const BucketTree::Bucket buckets = bucketsOf(place.node);
        for (std::uint32_t n = buckets.begin; n < buckets.end; ++n)
            if (all[n] > 0) {
                spacings[place.group].sum += all[n];
                ++spacings[place.group].count;
            }
    }
    for (std::size_t group = size / 2; group-- > 1;)
        spacings[group] = {spacings[2 * group].sum + spacings[2 * group + 1].sum,
                           spacings[2 * group].count + spacings[2 * group + 1].count};
    all.erase(std::remove(all.begin(), all.end(), 0.0f), all.end());
    if (all.empty()) {
        if (!mTree.nodes().empty())
            mStep = std::max(mTree.nodes()[0].box.diagonal().norm(), 1e-30f);
        return;
    }
    std::nth_element(all.begin(), all.begin() + std::ptrdiff_t(all.size() / 2), all.end());
    const float median = all[all.size() / 2];
    mStep = kStepSpacings * median;
    // Downwards: groups with too few spacings take that of the group above.
    std::vector<float> known(size, spacings[1].mean());
    for (std::size_t group = 2; group < size; ++group)
        known[group] =
            spacings[group].count >= kMinGroupBuckets ? spacings[group].mean() : known[group / 2];
    for (std::size_t group = size; group-- > 1;)
        mFinest[group] =
            2 * group < size
                ? std::min(mFinest[2 * group], mFinest[2 * group + 1])
                : std::max(kMinLevel, int(std::floor(std::log2(known[group] / median) + 0.5f)));
}

/// Set @a best to the least level at leaves below @a at, if it is less.
/// @param levelOf  lower bound for the points of a place, and exact for leaves.
template <typename LevelOf>
void MomentTree::lessen(int& best, const Place& at, const LevelOf& levelOf) const
{
    if (mTree.nodes()[at.node].leaf) {
        best = std::min(best, levelOf(at));
        return;
    }
    std::array<Place, 2> children = childrenOf(at);
    std::array<int, 2> levels = {levelOf(children[0]), levelOf(children[1])};
    const std::size_t first = levels[1] < levels[0] ? 1 : 0;
    if (levels[first] < best) lessen(best, children[first], levelOf);
    if (levels[1 - first] < best) lessen(best, children[1 - first], levelOf);
}

int MomentTree::finestLevel(const Eigen::AlignedBox3f& box) const
{
    // Along each axis points add to nodes up to a step away, and places lie between nodes.
    const auto firstReaching = [this](float apart) {
        const auto levelFor = [&](int level) {
            const float reach = 1 + 1 / float(nodesPerStep(level)); // steps
            return int(std::ceil(std::log2(apart / (reach * mStep)) - 1e-3f));
        };
        return levelFor(0) < kMinFineLevel ? levelFor(0)
                                           : std::max(kMinFineLevel, levelFor(kMinFineLevel));
    };
    const auto levelOf = [&](const Place& place) {
        const Eigen::AlignedBox3f& b = mTree.nodes()[place.node].box;
        const float apart =
            (b.min() - box.max()).cwiseMax(box.min() - b.max()).cwiseMax(0.0f).maxCoeff();
        int level = mFinest[place.group];
        if (apart > 0) level = std::max(level, firstReaching(apart));
        return level;
    };
    int best = std::numeric_limits<int>::max();
    if (!mTree.nodes().empty()) lessen(best, {}, levelOf);
    return best;
}

} // namespace mpuvdb
