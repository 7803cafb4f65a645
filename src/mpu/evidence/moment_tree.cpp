#include "moment_tree.h"

#include "core/clones.h"

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

constexpr std::uint32_t kBucketPoints = 8; ///< points of a leaf [tuned: attributes_bench, time]
/// Least confidence: points without any count only where there are no others. [derived: below what
/// floats resolve beside 1]
constexpr float kMinConfidence = 1e-9f;
/// Step of level 0, spacings: weights have a mean spread of 0.58 steps, those of a ball with a
/// dozen points one of 0.8 spacings. [tuned: attributes_bench; 1.2 leaves 8 % more noise, 1.4 blurs
/// 15 % more]
constexpr float kStepSpacings = 1.3f;
/// Least buckets of a spacing. [derived: 64 points give it to an eighth]
constexpr std::uint32_t kMinSpacingBuckets = 8;
/// Finest level, with steps an eighth of the usual: windows of finer ones cost too much.
/// [tuned: attributes_bench, time]
constexpr int kMinLevel = -3;

/// The least squared distance from one of the @a count points from @a begin on to its third
/// neighbor among them.
MPUVDB_CLONES
float leastToThird(const PointArrays& points, std::uint32_t begin, std::uint32_t count)
{
    using Lanes = float __attribute__((vector_size(4 * kBucketPoints)));
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

MomentTree::MomentTree(const SortedPoints& points, const Channels& channels)
    : mPoints(points.points()), mChannels(channels), mTree(points.tree(kBucketPoints)),
      mLength((channels.size() + 4) / 4 * kLanes)
{
    for (const float* const channel : mChannels)
        mReferences.push_back(mPoints.size() > 0 ? channel[0] : 0);
    const double confidence =
        std::accumulate(mPoints.confidence, mPoints.confidence + mPoints.size(), 0.0);
    if (confidence > 0) mPerConfidence = float(double(mPoints.size()) / confidence);
    findLevels();
    sumUp();
}

/// @param area  that is the point's, in those of points with the median spacing.
void MomentTree::sumsOf(std::uint32_t point, float area, float* sums) const
{
    using Four = float __attribute__((vector_size(16)));
    const float confidence = std::max(mPoints.confidence[point] * mPerConfidence, kMinConfidence);
    const float weight = confidence * area;
    const auto quantity = [&](std::size_t n) {
        if (n > mChannels.size()) return 0.0f;
        return n == 0 ? weight : weight * (mChannels[n - 1][point] - mReferences[n - 1]);
    };
    for (std::size_t n = 0; n < mLength / 4; n += 4) {
        const Four four{quantity(n), quantity(n + 1), quantity(n + 2), quantity(n + 3)};
        const Four moments[] = {four, four * mPoints.nx[point], four * mPoints.ny[point],
                                four * mPoints.nz[point]};
        std::memcpy(sums + 4 * n, moments, sizeof moments);
    }
}

void MomentTree::sumUp()
{
    const auto& nodes = mTree.nodes();
    mSums.assign(nodes.size() * mLength, 0);
    mMiddles.assign(nodes.size(), Vec3f::Zero());
    const auto sumsAt = [this](std::size_t node) { return mSums.data() + node * mLength; };
    const auto add = [&](std::size_t at, const float* from, const Vec3f& middle) {
        float* const into = sumsAt(at);
        for (std::size_t i = 0; i < mLength; ++i) into[i] += from[i];
        mMiddles[at] += from[0] / into[0] * (middle - mMiddles[at]);
    };
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, nodes.size()), [&](const auto& range) {
        std::vector<float> sums(mLength);
        for (std::size_t at = range.begin(); at < range.end(); ++at) {
            if (!nodes[at].leaf) continue;
            const BucketTree::Bucket& bucket = mTree.bucketOf(std::uint32_t(at));
            const float area = areaAt(at);
            for (std::uint32_t n = bucket.begin; n < bucket.end; ++n) {
                sumsOf(n, area, sums.data());
                add(at, sums.data(), position(n));
            }
        }
    });
    for (std::size_t at = nodes.size(); at-- > 0;)
        if (!nodes[at].leaf)
            for (const std::size_t child : {at + 1, std::size_t(nodes[at].second)})
                add(at, sumsAt(child), mMiddles[child]);
}

/// The spacing by the distance to the third neighbor, the least in a bucket; 0 for too few points.
float MomentTree::spacingIn(const BucketTree::Bucket& bucket) const
{
    const std::uint32_t count = std::min(bucket.end - bucket.begin, kBucketPoints);
    return count < 4 ? 0 : std::sqrt(float(M_PI) / 3 * leastToThird(mPoints, bucket.begin, count));
}

/// Set each point's finest level by the spacing about it.
void MomentTree::findLevels()
{
    struct Spacings {
        float sum = 0;
        std::uint32_t count = 0;
    };
    const auto& nodes = mTree.nodes();
    std::vector<float> all(mTree.buckets().size());
    tbb::parallel_for(std::size_t(0), all.size(),
                      [&](std::size_t n) { all[n] = spacingIn(mTree.buckets()[n]); });
    const std::vector<Spacings> spacings = mTree.perNode<Spacings>(
        [&](std::uint32_t bucket) {
            return all[bucket] > 0 ? Spacings{all[bucket], 1} : Spacings{};
        },
        [](const Spacings& a, const Spacings& b) {
            return Spacings{a.sum + b.sum, a.count + b.count};
        });
    all.erase(std::remove(all.begin(), all.end(), 0.0f), all.end());
    mFinest.assign(nodes.size(), 0);
    if (all.empty()) {
        if (!nodes.empty()) mStep = std::max(nodes[0].box.diagonal().norm(), 1e-30f);
        return;
    }
    std::nth_element(all.begin(), all.begin() + std::ptrdiff_t(all.size() / 2), all.end());
    const float median = all[all.size() / 2];
    mStep = kStepSpacings * median;
    // Downwards: nodes with too few buckets take the spacing of the node above.
    std::vector<float> known(nodes.size(), median);
    for (std::size_t n = 0; n < nodes.size(); ++n) {
        if (n == 0 || spacings[n].count >= kMinSpacingBuckets)
            known[n] = spacings[n].sum / float(spacings[n].count);
        if (nodes[n].leaf) continue;
        known[n + 1] = known[n];
        known[nodes[n].second] = known[n];
    }
    std::vector<int> finest(nodes.size());
    for (std::size_t n = nodes.size(); n-- > 0;)
        mFinest[n] = nodes[n].leaf
                         ? std::max(kMinLevel, int(std::floor(std::log2(known[n] / median) + 0.5f)))
                         : std::min(mFinest[n + 1], mFinest[nodes[n].second]);
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
    const auto levelOf = [&](std::uint32_t node) {
        const Eigen::AlignedBox3f& b = mTree.nodes()[node].box;
        const float apart =
            (b.min() - box.max()).cwiseMax(box.min() - b.max()).cwiseMax(0.0f).maxCoeff();
        int level = mFinest[node];
        if (apart > 0) level = std::max(level, firstReaching(apart));
        return level;
    };
    int best = std::numeric_limits<int>::max();
    mTree.search([&](std::uint32_t node) { return float(levelOf(node)); },
                 [&] { return float(best) - 1; },
                 [&](std::uint32_t leaf) { best = std::min(best, levelOf(leaf)); });
    return best;
}

} // namespace mpuvdb
