#include "data_coverage.h"

#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

constexpr float kFull = 2.5f, kNone = 5; ///< distances in spacings between which coverage falls
constexpr std::size_t kBucketPoints = 40;
constexpr std::size_t kNeighbors = 12;  ///< that a spacing is measured with
constexpr std::size_t kRemembered = 16; ///< points that supported places before

float coverageOf(float ratio)
{
    const float t = std::clamp((ratio - kFull) / (kNone - kFull), 0.0f, 1.0f);
    return 1 - t * t * (3 - 2 * t);
}

float median(float* begin, float* end)
{
    float* const middle = begin + (end - begin) / 2;
    std::nth_element(begin, middle, end);
    return *middle;
}

} // namespace

class DataCoverage::Neighbors
{
public:
    struct Neighbor {
        float squaredDistance;
        std::uint32_t bucket;
    };

    explicit Neighbors(const Vec3f& at) : mAt(at) {}

    const Vec3f& at() const { return mAt; }
    /// Squared distance from which on points are not wanted.
    float reach() const
    {
        return mCount < mNearest.size() ? std::numeric_limits<float>::max()
                                        : mNearest.back().squaredDistance;
    }
    void add(float squaredDistance, std::uint32_t bucket)
    {
        if (!(squaredDistance < reach())) return;
        std::size_t i = mCount < mNearest.size() ? mCount++ : mCount - 1;
        for (; i > 0 && mNearest[i - 1].squaredDistance > squaredDistance; --i)
            mNearest[i] = mNearest[i - 1];
        mNearest[i] = {squaredDistance, bucket};
    }
    /// A disc that holds j neighbors has an area of j cells, each a spacing squared.
    float spacing() const
    {
        if (mCount < 2) return 0;
        return float(std::sqrt(M_PI / double(mCount - 1) * mNearest[mCount - 1].squaredDistance));
    }
    const Neighbor* begin() const { return mNearest.data(); }
    const Neighbor* end() const { return mNearest.data() + mCount; }

private:
    Vec3f mAt;
    std::array<Neighbor, kNeighbors + 1> mNearest; ///< the first is the point itself
    std::size_t mCount = 0;
};

DataCoverage::DataCoverage(const SortedPoints& points, const Vec3d& frame, Interrupter& progress)
    : mPoints(points.points()), mFrame(frame), mTree(points.tree(kBucketPoints))
{
    progress.check();
    measureSpacings(progress);
}

inline float DataCoverage::ratioOf(std::uint32_t n, float spacing, const Vec3f& p,
                                   const Vec3f& normal) const
{
    const float cosine =
        mPoints.nx[n] * normal[0] + mPoints.ny[n] * normal[1] + mPoints.nz[n] * normal[2];
    const float reach = spacing * std::clamp(1 + 2 * cosine, 0.0f, 1.0f);
    return reach > 0 ? (position(n) - p).norm() / reach : kNone;
}

/// The spacing at one point of each bucket; then what the median of its neighbors' buckets have:
/// the neighbors of an outlier know better.
void DataCoverage::measureSpacings(Interrupter& progress)
{
    const std::size_t count = mTree.buckets().size();
    const auto forEachBucket = [&](auto f) {
        tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, 64),
                          [&](const tbb::blocked_range<std::size_t>& range) {
                              progress.check();
                              for (std::size_t b = range.begin(); b < range.end(); ++b) f(b);
                          });
    };
    std::vector<float> own(count);
    std::vector<std::array<std::uint32_t, kNeighbors + 1>> near(count);
    forEachBucket([&](std::size_t b) {
        const BucketTree::Bucket& bucket = mTree.buckets()[b];
        Neighbors found(position((bucket.begin + bucket.end) / 2));
        gather(found);
        own[b] = found.spacing();
        near[b].fill(std::uint32_t(b)); // where there are too few
        std::transform(found.begin(), found.end(), near[b].begin(),
                       [](const auto& n) { return n.bucket; });
    });
    std::vector<float> spacings(count);
    forEachBucket([&](std::size_t b) {
        std::array<float, kNeighbors + 1> values;
        std::transform(near[b].begin(), near[b].end(), values.begin(),
                       [&](std::uint32_t n) { return own[n]; });
        spacings[b] = median(values.data(), values.data() + values.size());
    });
    mSpacings = mTree.perNode<float>([&](std::uint32_t bucket) { return spacings[bucket]; },
                                     [](float a, float b) { return std::max(a, b); });
    mSpacing = double(median(own.data(), own.data() + own.size()));
}

void DataCoverage::gather(Neighbors& neighbors) const
{
    const Vec3f& at = neighbors.at();
    mTree.search(
        [&](std::uint32_t node) { return mTree.nodes()[node].box.squaredExteriorDistance(at); },
        [&] { return neighbors.reach(); },
        [&](std::uint32_t leaf) {
            const BucketTree::Bucket& bucket = mTree.bucketOf(leaf);
            for (std::size_t n = bucket.begin; n < bucket.end; ++n)
                neighbors.add((position(n) - at).squaredNorm(), mTree.nodes()[leaf].second);
        });
}

DataCoverage::Support DataCoverage::bestSupport(const Vec3f& p, const Vec3f& normal) const
{
    constexpr float kNothing = -1; // the best is as good as any
    Support best{kNone};
    mTree.search(
        [&](std::uint32_t node) { // squared ratio
            const float widest = mSpacings[node];
            const float d2 = mTree.nodes()[node].box.squaredExteriorDistance(p);
            return widest > 0 ? d2 / (widest * widest) : kNone * kNone;
        },
        [&] { return best.ratio > kFull ? best.ratio * best.ratio : kNothing; },
        [&](std::uint32_t leaf) {
            const BucketTree::Bucket& bucket = mTree.bucketOf(leaf);
            const float spacing = mSpacings[leaf];
            for (std::uint32_t n = bucket.begin; n < bucket.end; ++n) {
                const float ratio = ratioOf(n, spacing, p, normal);
                if (ratio < best.ratio) best = {ratio, n, spacing};
            }
        });
    return best;
}

void DataCoverage::evaluate(const std::vector<SurfacePlace>& places,
                            std::vector<float>& values) const
{
    values.resize(places.size());
    std::array<Support, kRemembered> witnesses; // what supported places before often does again
    std::size_t count = 0;
    for (std::size_t i = 0; i < places.size(); ++i) {
        const Vec3f p = (places[i].position - mFrame).cast<float>();
        const Vec3f normal = places[i].normal.cast<float>();
        const auto known = std::min(count, kRemembered);
        if (std::any_of(witnesses.begin(), witnesses.begin() + known, [&](const Support& w) {
                return ratioOf(w.point, w.spacing, p, normal) <= kFull;
            })) {
            values[i] = 1;
            continue;
        }
        const Support best = bestSupport(p, normal);
        values[i] = coverageOf(best.ratio);
        if (best.ratio <= kFull) witnesses[count++ % kRemembered] = best;
    }
}

} // namespace mpuvdb
