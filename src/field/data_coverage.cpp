#include "data_coverage.h"

#include <mpuvdb/progress.h>

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
constexpr std::size_t kNeighbours = 12; ///< that a spacing is measured with
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

class DataCoverage::Neighbours
{
public:
    struct Neighbour {
        float squaredDistance;
        std::uint32_t bucket;
    };

    explicit Neighbours(const Vec3f& at) : mAt(at) {}

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
    /// A disc that holds j neighbours has an area of j cells, each a spacing squared.
    float spacing() const
    {
        if (mCount < 2) return 0;
        return float(std::sqrt(M_PI / double(mCount - 1) * mNearest[mCount - 1].squaredDistance));
    }
    const Neighbour* begin() const { return mNearest.data(); }
    const Neighbour* end() const { return mNearest.data() + mCount; }

private:
    Vec3f mAt;
    std::array<Neighbour, kNeighbours + 1> mNearest; ///< the first is the point itself
    std::size_t mCount = 0;
};

DataCoverage::DataCoverage(const SortedPoints& points, const Vec3d& frame, Progress& progress)
    : mPoints(points.points()), mFrame(frame)
{
    points.forEachBucket(kBucketPoints, [&](std::size_t begin, std::size_t end) {
        mBuckets.push_back({std::uint32_t(begin), std::uint32_t(end), 0});
    });
    progress.check();
    mNodes.reserve(2 * mBuckets.size());
    build(0, mBuckets.size());
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

std::uint32_t DataCoverage::build(std::size_t begin, std::size_t end)
{
    const auto at = std::uint32_t(mNodes.size());
    mNodes.push_back({});
    Node node{};
    node.leaf = end - begin == 1;
    if (node.leaf) {
        node.second = std::uint32_t(begin);
        for (std::size_t n = mBuckets[begin].begin; n < mBuckets[begin].end; ++n)
            node.box.extend(position(n));
    } else {
        const std::size_t middle = (begin + end) / 2;
        const std::uint32_t first = build(begin, middle);
        node.second = build(middle, end);
        node.box = mNodes[first].box.merged(mNodes[node.second].box);
    }
    mNodes[at] = node;
    return at;
}

/// The spacing at one point of each bucket; then what the median of its neighbours' buckets have:
/// the neighbours of an outlier know better.
void DataCoverage::measureSpacings(Progress& progress)
{
    const auto forEachBucket = [&](auto f) {
        tbb::parallel_for(tbb::blocked_range<std::size_t>(0, mBuckets.size(), 64),
                          [&](const tbb::blocked_range<std::size_t>& range) {
                              progress.check();
                              for (std::size_t b = range.begin(); b < range.end(); ++b) f(b);
                          });
    };
    std::vector<float> own(mBuckets.size());
    std::vector<std::array<std::uint32_t, kNeighbours + 1>> near(mBuckets.size());
    forEachBucket([&](std::size_t b) {
        Neighbours found(position((mBuckets[b].begin + mBuckets[b].end) / 2));
        gather(0, found);
        own[b] = found.spacing();
        near[b].fill(std::uint32_t(b)); // where there are too few
        std::transform(found.begin(), found.end(), near[b].begin(),
                       [](const auto& n) { return n.bucket; });
    });
    forEachBucket([&](std::size_t b) {
        std::array<float, kNeighbours + 1> values;
        std::transform(near[b].begin(), near[b].end(), values.begin(),
                       [&](std::uint32_t n) { return own[n]; });
        mBuckets[b].spacing = median(values.data(), values.data() + values.size());
    });
    for (std::size_t n = mNodes.size(); n-- > 0;) { // children stand after their parents
        Node& node = mNodes[n];
        node.spacing = node.leaf ? mBuckets[node.second].spacing
                                 : std::max(mNodes[n + 1].spacing, mNodes[node.second].spacing);
    }
    mSpacing = double(median(own.data(), own.data() + own.size()));
}

void DataCoverage::gather(std::uint32_t at, Neighbours& neighbours) const
{
    const Node& node = mNodes[at];
    if (node.leaf) {
        const Bucket& bucket = mBuckets[node.second];
        for (std::size_t n = bucket.begin; n < bucket.end; ++n)
            neighbours.add((position(n) - neighbours.at()).squaredNorm(), node.second);
        return;
    }
    std::uint32_t child[2] = {at + 1, node.second};
    float d2[2];
    for (int c = 0; c < 2; ++c)
        d2[c] = mNodes[child[c]].box.squaredExteriorDistance(neighbours.at());
    const int nearer = d2[1] < d2[0];
    if (d2[nearer] < neighbours.reach()) gather(child[nearer], neighbours);
    if (d2[1 - nearer] < neighbours.reach()) gather(child[1 - nearer], neighbours);
}

void DataCoverage::improve(std::uint32_t at, const Vec3f& p, const Vec3f& normal,
                           Support& best) const
{
    const Node& node = mNodes[at];
    if (node.leaf) {
        const Bucket& bucket = mBuckets[node.second];
        for (std::uint32_t n = bucket.begin; n < bucket.end; ++n) {
            const float ratio = ratioOf(n, bucket.spacing, p, normal);
            if (ratio < best.ratio) best = {ratio, n, bucket.spacing};
        }
        return;
    }
    std::uint32_t child[2] = {at + 1, node.second};
    float d2[2];
    for (int c = 0; c < 2; ++c) d2[c] = mNodes[child[c]].box.squaredExteriorDistance(p);
    const int nearer = d2[1] < d2[0];
    for (const int c : {nearer, 1 - nearer}) {
        if (best.ratio <= kFull) return; // as good as any
        const float reach = best.ratio * mNodes[child[c]].spacing;
        if (d2[c] < reach * reach) improve(child[c], p, normal, best);
    }
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
        Support best{kNone};
        improve(0, p, normal, best);
        values[i] = coverageOf(best.ratio);
        if (best.ratio <= kFull) witnesses[count++ % kRemembered] = best;
    }
}

} // namespace mpuvdb
