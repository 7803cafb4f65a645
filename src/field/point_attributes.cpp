#include "point_attributes.h"

#include "quadric.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace mpuvdb
{
namespace
{

constexpr std::size_t kNeighbours = 12;
constexpr float kReach = 1.25f;          ///< radius of the ball, in distances of the last neighbour
constexpr std::size_t kMost = 64;        ///< points in it, where they are all about as far
constexpr float kLeastAgreement = 0.25f; ///< of a point that faces another way
constexpr std::size_t kBucketPoints = 40;

/// How a point's distance counts: in full up to 60 degrees between normals, as four times itself
/// from some 110 on. (Data coverage measures alike.)
float agreement(float cosine)
{
    return std::clamp(1 + 2 * cosine, kLeastAgreement, 1.0f);
}

} // namespace

/// The points in the ball that balances them about some place.
class PointAttributes::Neighbourhood
{
public:
    explicit Neighbourhood(const PointAttributes& of) : mOf(of) {}

    /// Blend the channels at @a p (local coordinates) into @a values.
    void blend(const Vec3f& p, const Vec3f& normal, float* values)
    {
        find(p, normal);
        const float radius = std::sqrt(mReach), scale = radius > 0 ? 1.5f / radius : 0;
        double sum = 0;
        mSums.assign(mOf.mChannels.size(), 0);
        const auto add = [&](std::uint32_t n, double w) {
            sum += w;
            for (std::size_t c = 0; c < mSums.size(); ++c)
                mSums[c] += w * double(mOf.mChannels[c][n]);
        };
        for (const Found& f : mFound)
            add(f.point, double(mOf.mPoints.confidence[f.point] *
                                bsplineWeight(scale * std::sqrt(f.squared))));
        if (!(sum > 0)) // all are equally far
            for (const Found& f : mFound) add(f.point, 1);
        for (std::size_t c = 0; c < mSums.size(); ++c) values[c] = float(mSums[c] / sum);
    }

private:
    struct Found {
        std::uint32_t point;
        float squared; ///< distance, as it counts
    };

    /// Fill mFound with the points of the ball, in their order, and mReach with its radius.
    void find(const Vec3f& p, const Vec3f& normal)
    {
        // Whoever was near the place before is near to this one, too: the rest need not be farther.
        mNearest.fill(kFarthest);
        mReach = kFarthest;
        for (const Found& f : mFound) count(squaredDistance(f.point, p, normal));
        mNearest.fill(kFarthest); // they will be found again
        mFound.clear();
        mCrowd = 2 * kMost;
        mOf.mTree.search([&](std::uint32_t node) { return leastSquared(node, p, normal); },
                         [this] { return mReach; },
                         [&](std::uint32_t leaf) { take(mOf.mTree.bucketOf(leaf), p, normal); });
        dropCrowd();
        std::sort(mFound.begin(), mFound.end(),
                  [](const Found& a, const Found& b) { return a.point < b.point; });
    }

    /// Distance at least of the points of a node of the tree.
    float leastSquared(std::uint32_t node, const Vec3f& p, const Vec3f& normal) const
    {
        const float d2 = kBelow * mOf.mTree.nodes()[node].box.squaredExteriorDistance(p);
        if (d2 >= mReach) return d2;
        const Eigen::AlignedBox3f& box = mOf.mNormals[node];
        const float most = agreement(
            box.min().cwiseProduct(normal).cwiseMax(box.max().cwiseProduct(normal)).sum());
        return d2 / (most * most);
    }

    void take(const BucketTree::Bucket& bucket, const Vec3f& p, const Vec3f& normal)
    {
        const std::size_t size = bucket.end - bucket.begin;
        mSquared.resize(size);
        float* const squared = mSquared.data();
        const float* const xs = &mOf.mPoints.x[bucket.begin];
        const float* const ys = &mOf.mPoints.y[bucket.begin];
        const float* const zs = &mOf.mPoints.z[bucket.begin];
        for (std::size_t i = 0; i < size; ++i) {
            const float x = xs[i] - p[0], y = ys[i] - p[1], z = zs[i] - p[2];
            squared[i] = x * x + y * y + z * z;
        }
        for (std::size_t i = 0; i < size; ++i) {
            if (!(squared[i] <= mReach)) continue;
            const auto n = std::uint32_t(bucket.begin + i);
            const float d2 = squaredDistance(n, p, normal);
            if (!(d2 <= mReach)) continue;
            mFound.push_back({n, d2});
            count(d2);
        }
        if (mFound.size() > mCrowd) dropCrowd();
    }

    float squaredDistance(std::uint32_t n, const Vec3f& p, const Vec3f& normal) const
    {
        const PointBatch& at = mOf.mPoints;
        const float x = at.x[n] - p[0], y = at.y[n] - p[1], z = at.z[n] - p[2];
        const float most =
            agreement(at.nx[n] * normal[0] + at.ny[n] * normal[1] + at.nz[n] * normal[2]);
        return (x * x + y * y + z * z) / (most * most);
    }

    /// Lessen the reach to what one more point at a distance lets it be.
    void count(float squared)
    {
        if (squared >= mNearest.back()) return;
        std::size_t i = mNearest.size() - 1;
        for (; i > 0 && mNearest[i - 1] > squared; --i) mNearest[i] = mNearest[i - 1];
        mNearest[i] = squared;
        const std::size_t wanted = std::min(kNeighbours, mOf.mPoints.size());
        mReach = std::min(mReach, kReach * kReach * mNearest[wanted - 1]);
    }

    void dropBeyond()
    {
        const auto beyond = [this](const Found& f) { return !(f.squared <= mReach); };
        mFound.erase(std::remove_if(mFound.begin(), mFound.end(), beyond), mFound.end());
    }

    /// Lessen the reach to what holds no more points than may be.
    void dropCrowd()
    {
        dropBeyond();
        if (mFound.size() > kMost) {
            const auto last = mFound.begin() + std::ptrdiff_t(kMost - 1);
            std::nth_element(mFound.begin(), last, mFound.end(),
                             [](const Found& a, const Found& b) { return a.squared < b.squared; });
            mReach = last->squared;
            dropBeyond();
        }
        mCrowd = mFound.size() + kMost;
    }

    static constexpr float kFarthest = std::numeric_limits<float>::max();
    static constexpr float kBelow = 1 - 1e-5f; ///< what rounding cannot undo

    const PointAttributes& mOf;
    std::vector<Found> mFound;
    float mReach = 0;       ///< squared
    std::size_t mCrowd = 0; ///< found points that are worth a look at what is too far
    std::array<float, kNeighbours> mNearest; ///< squared distances, ascending
    std::vector<float> mSquared;
    std::vector<double> mSums;
};

PointAttributes::PointAttributes(const SortedPoints& points, const Vec3d& frame,
                                 const std::vector<std::string>& names)
    : mPoints(points.points()), mFrame(frame), mTree(points, kBucketPoints)
{
    const auto& scalars = points.scalarNames();
    const std::size_t colors = points.hasColors() ? 3 : 0;
    for (const std::string& name : names) {
        const auto found = std::find(scalars.begin(), scalars.end(), name);
        const auto place = std::size_t(found - scalars.begin());
        if (name == kColorName && colors > 0) {
            mHasColors = true;
            for (std::size_t c = 0; c < colors; ++c)
                mChannels.insert(mChannels.begin() + std::ptrdiff_t(c),
                                 points.channels()[c].data());
        } else if (name == "confidence" || found != scalars.end()) {
            mScalarNames.push_back(name);
            mChannels.push_back(found != scalars.end() ? points.channels()[colors + place].data()
                                                       : points.points().confidence.data());
        } else {
            throw UsageError(fmt::format("the points have no '{}': name {}confidence{}{}", name,
                                         colors > 0 ? "Cd, " : "", scalars.empty() ? "" : ", ",
                                         fmt::join(scalars, ", ")));
        }
    }
    mNormals = mTree.perNode<Eigen::AlignedBox3f>(
        [&](std::uint32_t bucket) {
            Eigen::AlignedBox3f box;
            for (std::uint32_t n = mTree.buckets()[bucket].begin; n < mTree.buckets()[bucket].end;
                 ++n)
                box.extend(Vec3f(mPoints.nx[n], mPoints.ny[n], mPoints.nz[n]));
            return box;
        },
        [](const Eigen::AlignedBox3f& a, const Eigen::AlignedBox3f& b) { return a.merged(b); });
}

void PointAttributes::evaluate(const std::vector<SurfacePlace>& places,
                               std::vector<float>& values) const
{
    values.resize(places.size() * channels());
    Neighbourhood near(*this);
    for (std::size_t i = 0; i < places.size(); ++i)
        near.blend((places[i].position - mFrame).cast<float>(), places[i].normal.cast<float>(),
                   values.data() + i * channels());
}

} // namespace mpuvdb
