#include "data_coverage.h"

#include "points_around.h"
#include "spatial/spanning_neighbors.h"

#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tuple>

namespace mpuvdb
{
namespace
{

/// Distance up to which points count, spacings: holes as wide as twice this are closed.
/// [tuned: coverage_test]
constexpr float kReach = 3.75f;
/// Distances beyond the points between which coverage falls from 1 to 0, spacings. [derived: the
/// outermost points stand for half a spacing more, and the next would be a whole one away]
constexpr float kFull = 0.5f, kNone = 1.0f;
constexpr std::size_t kBucketPoints = 40; ///< points of a bucket [tuned: coverage_test]
/// Points remembered that surrounded places before. [free: time]
constexpr std::size_t kMaxWitnesses = 16;

/// @param beyond  distance beyond the points, spacings.
float coverageOf(float beyond)
{
    const float t = std::clamp((beyond - kFull) / (kNone - kFull), 0.0f, 1.0f);
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
    /// @param most  how many.
    Neighbors(const Vec3f& at, std::size_t most) : mAt(at), mMost(most) { mHeap.reserve(most); }

    const Vec3f& at() const { return mAt; }
    /// Squared distance from which on points are not among the nearest.
    float reach() const
    {
        return mHeap.size() < mMost ? std::numeric_limits<float>::max()
                                    : mHeap.front().squaredDistance;
    }
    void add(std::uint32_t point, float squaredDistance, std::uint32_t bucket)
    {
        if (!(squaredDistance < reach())) return;
        if (mHeap.size() == mMost) {
            std::pop_heap(mHeap.begin(), mHeap.end(), isNearer);
            mHeap.pop_back();
        }
        mHeap.push_back({squaredDistance, bucket, point});
        std::push_heap(mHeap.begin(), mHeap.end(), isNearer);
    }
    std::size_t count() const { return mHeap.size(); }
    const std::vector<Neighbor>& all() const { return mHeap; }
    /// Nearest first.
    std::vector<Neighbor> sorted() const
    {
        std::vector<Neighbor> result = mHeap;
        std::sort_heap(result.begin(), result.end(), isNearer);
        return result;
    }

private:
    static bool isNearer(const Neighbor& a, const Neighbor& b)
    {
        return std::tie(a.squaredDistance, a.point) < std::tie(b.squaredDistance, b.point);
    }

    Vec3f mAt;
    std::size_t mMost;
    std::vector<Neighbor> mHeap; ///< the farthest first
};

DataCoverage::DataCoverage(const SortedPoints& points, const Vec3d& frame, Interrupter& progress)
    : mPoints(points.points()), mFrame(frame), mTree(points.tree(kBucketPoints))
{
    progress.check();
    measureSpacings(progress);
}

/// The distance of a point in spacings, in which points that face away are farther.
inline float DataCoverage::ratioOf(const Spaced& point, const Vec3f& offset,
                                   const Vec3f& normal) const
{
    const std::uint32_t n = point.point;
    const float cosine =
        mPoints.nx[n] * normal[0] + mPoints.ny[n] * normal[1] + mPoints.nz[n] * normal[2];
    const float scale = point.spacing * std::clamp(1 + 2 * cosine, 0.0f, 1.0f);
    return scale > 0 ? offset.norm() / scale : kReach;
}

/// Measure the spacing at one point of each bucket, then take the median of its neighbors' buckets,
/// which an outlier does not change.
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
    std::vector<BucketsAbout> near(count);
    forEachBucket([&](std::size_t b) {
        near[b].fill(std::uint32_t(b)); // for where there are too few
        own[b] = spacingOf(mTree.buckets()[b], near[b]);
    });
    std::vector<float> spacings(count);
    forEachBucket([&](std::size_t b) {
        std::array<float, kAbout> values;
        std::transform(near[b].begin(), near[b].end(), values.begin(),
                       [&](std::uint32_t n) { return own[n]; });
        spacings[b] = median(values.data(), values.data() + values.size());
    });
    mSpacings = mTree.perNode<float>([&](std::uint32_t bucket) { return spacings[bucket]; },
                                     [](float a, float b) { return std::max(a, b); });
    mSpacing = double(median(own.data(), own.data() + own.size()));
}

/// The spacing about the middle point of a bucket: of the disc of its first neighbors that span a
/// plane, along scan lines those on several.
/// @param near  set to the buckets of the nearest.
float DataCoverage::spacingOf(const BucketTree::Bucket& bucket, BucketsAbout& near) const
{
    const Vec3f at = position((bucket.begin + bucket.end) / 2);
    for (std::size_t few = kSpacingNeighbors;; few *= 2) {
        Neighbors found(at, few + 1);
        gather(found);
        if (found.count() < 2) return 0;
        const bool isLast = found.count() <= few || 2 * few > kMostSpanning;
        if (!isLast && !spansPlane(found)) continue;
        const std::vector<Neighbor> sorted = found.sorted();
        for (std::size_t n = 0; n < std::min(near.size(), sorted.size()); ++n)
            near[n] = sorted[n].bucket;
        // A disc that holds j neighbors has an area of j spacings squared.
        return float(std::sqrt(M_PI / double(sorted.size() - 1) * sorted.back().squaredDistance));
    }
}

bool DataCoverage::spansPlane(const Neighbors& neighbors) const
{
    Eigen::Matrix3f squares = Eigen::Matrix3f::Zero();
    for (const Neighbor& n : neighbors.all()) {
        const Vec3f d = position(n.point) - neighbors.at();
        squares += d * d.transpose();
    }
    return mpuvdb::spansPlane(squares, 0);
}

void DataCoverage::gather(Neighbors& neighbors) const
{
    const Vec3f& at = neighbors.at();
    mTree.search(
        [&](std::uint32_t node) { return mTree.nodes()[node].box.squaredExteriorDistance(at); },
        [&] { return neighbors.reach(); },
        [&](std::uint32_t leaf) {
            const BucketTree::Bucket& bucket = mTree.bucketOf(leaf);
            for (std::uint32_t n = bucket.begin; n < bucket.end; ++n)
                neighbors.add(n, (position(n) - at).squaredNorm(), mTree.nodes()[leaf].second);
        });
}

float DataCoverage::search(const Vec3f& p, const Vec3f& normal, PointsAround& around,
                           std::vector<Spaced>& surrounding) const
{
    constexpr float kStop = -1; ///< reach that ends a search [derived: below all squares]
    float least = kReach, spacing = 0;
    mTree.search(
        [&](std::uint32_t node) { // squared ratio
            const float widest = mSpacings[node];
            const float d2 = mTree.nodes()[node].box.squaredExteriorDistance(p);
            return widest > 0 ? d2 / (widest * widest) : kReach * kReach;
        },
        [&] { return around.surround() ? kStop : kReach * kReach; },
        [&](std::uint32_t leaf) {
            const BucketTree::Bucket& bucket = mTree.bucketOf(leaf);
            for (std::uint32_t n = bucket.begin; n < bucket.end; ++n) {
                const Spaced point{n, mSpacings[leaf]};
                const Vec3f offset = position(n) - p;
                const float ratio = ratioOf(point, offset, normal);
                if (!(ratio < kReach)) continue;
                if (around.add(offset)) surrounding.push_back(point);
                if (ratio < least || spacing == 0) spacing = point.spacing;
                least = std::min(least, ratio);
            }
        });
    if (around.surround()) return 0;
    return spacing > 0 ? around.distanceToHull() / spacing : kNone;
}

void DataCoverage::evaluate(const std::vector<SurfacePlace>& places,
                            std::vector<float>& values) const
{
    values.resize(places.size());
    PointsAround around;
    std::vector<Spaced> surrounding;
    std::array<Spaced, kMaxWitnesses> witnesses; // points that surrounded places before
    std::size_t count = 0;
    for (std::size_t i = 0; i < places.size(); ++i) {
        const Vec3f p = (places[i].position - mFrame).cast<float>();
        const Vec3f normal = places[i].normal.cast<float>();
        around.start(normal);
        for (std::size_t w = std::min(count, kMaxWitnesses); w-- > 0 && !around.surround();) {
            const Vec3f offset = position(witnesses[w].point) - p;
            if (ratioOf(witnesses[w], offset, normal) < kReach) around.add(offset);
        }
        values[i] = 1;
        if (around.surround()) continue;
        surrounding.clear();
        values[i] = coverageOf(search(p, normal, around, surrounding));
        for (const Spaced& point : surrounding) witnesses[count++ % kMaxWitnesses] = point;
    }
}

} // namespace mpuvdb
