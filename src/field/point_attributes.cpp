#include "point_attributes.h"

#include "quadric.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace mpuvdb
{
namespace
{

constexpr std::size_t kNeighbours = 12;
constexpr float kReach = 1.25f;          ///< radius of the ball, in distances of the last neighbour
constexpr float kLeastAgreement = 0.25f; ///< of a point that faces another way
constexpr float kGuess = 1.25f;          ///< how far to look first, in radii of the last ball
constexpr double kMargin = 3;            ///< of what is gathered, in radii of a ball
constexpr double kTooWide = 8;           ///< in radii of a ball: gather anew

/// How a point's distance counts: in full up to 60 degrees between normals, as four times itself
/// from some 110 on. (Data coverage measures alike.)
float agreement(float cosine)
{
    return std::clamp(1 + 2 * cosine, kLeastAgreement, 1.0f);
}

} // namespace

/// The points about some place, in their order, and the ball that balances them there.
class PointAttributes::Neighbourhood
{
public:
    explicit Neighbourhood(const PointAttributes& of)
        : mOf(of), mRadius(std::max(of.mBox.diagonal().norm() / 1024, 1e-30))
    {
    }

    /// Blend the channels at @a p (local coordinates) into @a values.
    void blend(const Vec3f& p, const Vec3f& normal, float* values)
    {
        mBall = findBall(p, normal);
        const PointBatch& points = mOf.mPoints.points();
        const float scale = mBall > 0 ? 1.5f / mBall : 0;
        double sum = 0;
        mSums.assign(mOf.mChannels.size(), 0);
        for (std::size_t i = 0; i < mNear.size(); ++i) {
            if (!(mDistances[i] <= mBall)) continue;
            const std::uint32_t n = mIndices[mNear[i]];
            const double w = double(points.confidence[n] * bsplineWeight(scale * mDistances[i]));
            sum += w;
            for (std::size_t c = 0; c < mSums.size(); ++c)
                mSums[c] += w * double(mOf.mChannels[c][n]);
        }
        for (std::size_t c = 0; c < mSums.size(); ++c) values[c] = float(mSums[c] / sum);
    }

private:
    /// The radius of the ball about @a p. All points in it are among mNear then, and more may be;
    /// which they are does not show in what is blended.
    float findBall(const Vec3f& p, const Vec3f& normal)
    {
        for (;; gather(p)) {
            const bool all = mIndices.size() == mOf.mPoints.size();
            const double complete = mRadius - (p.cast<double>() - mCentre).norm();
            const bool wide =
                mBall > 0 && mRadius > kTooWide * double(mBall) && mCentre != p.cast<double>();
            const float most = all ? kEverything : float(kBelow * complete);
            for (const float within : {std::min(kGuess * mBall, most), most}) {
                if (mIndices.empty() || !(within > 0)) continue;
                select(p, normal, within);
                const float radius = kReach * lastNeighbour();
                if (radius <= within && !(wide && !all)) return radius;
            }
            const bool enough = !mNear.empty() && mNear.size() >= kNeighbours;
            // Halved at most, lest it vanish where points coincide.
            mRadius = enough ? std::max(kMargin * double(kReach * lastNeighbour()), mRadius / 2)
                             : 2 * mRadius;
        }
    }

    /// Fill mNear with the places in mIndices of the points @a within that distance of @a p, and
    /// mDistances with how theirs count.
    void select(const Vec3f& p, const Vec3f& normal, float within)
    {
        const std::size_t count = mIndices.size();
        mSquared.resize(count);
        for (std::size_t i = 0; i < count; ++i) {
            const float x = mX[i] - p[0], y = mY[i] - p[1], z = mZ[i] - p[2];
            mSquared[i] = x * x + y * y + z * z;
        }
        mNear.resize(count);
        std::size_t near = 0;
        for (std::size_t i = 0; i < count; ++i) {
            mNear[near] = std::uint32_t(i);
            near += std::size_t(mSquared[i] <= within * within);
        }
        mNear.resize(near);
        const PointBatch& at = mOf.mPoints.points();
        mDistances.resize(near);
        for (std::size_t i = 0; i < near; ++i) {
            const std::uint32_t n = mIndices[mNear[i]];
            const float cosine = at.nx[n] * normal[0] + at.ny[n] * normal[1] + at.nz[n] * normal[2];
            mDistances[i] = std::sqrt(mSquared[mNear[i]]) / agreement(cosine);
        }
    }

    /// Distance to the last of a dozen neighbours, or of all there are; infinite where some may be
    /// missing.
    float lastNeighbour()
    {
        const std::size_t wanted = std::min(kNeighbours, mOf.mPoints.size());
        if (mNear.size() < wanted) return std::numeric_limits<float>::infinity();
        mSorted = mDistances;
        const auto last = mSorted.begin() + std::ptrdiff_t(wanted - 1);
        std::nth_element(mSorted.begin(), last, mSorted.end());
        return *last;
    }

    void gather(const Vec3f& p)
    {
        mCentre = p.cast<double>();
        mIndices.clear();
        mNear.clear();
        const Vec3d half = Vec3d::Constant(mRadius);
        mOf.mPoints.appendAround(Box3d(mCentre - half, mCentre + half), mIndices);
        const PointBatch& at = mOf.mPoints.points();
        const auto copy = [this](const PointBatch::Floats& from, std::vector<float>& to) {
            to.resize(mIndices.size());
            for (std::size_t i = 0; i < to.size(); ++i) to[i] = from[mIndices[i]];
        };
        copy(at.x, mX);
        copy(at.y, mY);
        copy(at.z, mZ);
    }

    static constexpr double kBelow = 1 - 1e-6; ///< what rounding to floats cannot undo
    static constexpr float kEverything = std::numeric_limits<float>::max();

    const PointAttributes& mOf;
    double mRadius; ///< of the ball about mCentre all of whose points are gathered
    Vec3d mCentre = Vec3d::Zero();
    float mBall = 0;                         ///< radius of the last ball
    std::vector<std::uint32_t> mIndices;     ///< of the points gathered
    std::vector<float> mX, mY, mZ, mSquared; ///< theirs
    std::vector<std::uint32_t> mNear;        ///< places in mIndices
    std::vector<float> mDistances, mSorted;  ///< of mNear, as they count
    std::vector<double> mSums;
};

PointAttributes::PointAttributes(const SortedPoints& points, const Vec3d& frame,
                                 const std::vector<std::string>& names)
    : mPoints(points), mFrame(frame)
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
    const PointBatch& at = points.points();
    for (std::size_t n = 0; n < points.size(); ++n) mBox.extend(Vec3d(at.x[n], at.y[n], at.z[n]));
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
