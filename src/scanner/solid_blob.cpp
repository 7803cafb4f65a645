// A sphere with fine bumps.
#include "solids.h"

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

/// Surface: |p| = radius + amplitude * s(p/|p|), s(u) = sin(b u_x) sin(b u_y) sin(b u_z), for which
/// |s| <= 1 and |grad s| <= b.
class Blob final : public Solid
{
public:
    Blob(double radius, double bumps, double amplitude)
        : mRadius(radius), mBumps(bumps), mAmplitude(amplitude)
    {
        // The steepest slope of the offset, as far inside as foot points can lie.
        mSteepest = std::hypot(1.0, amplitude * bumps / (radius - 5 * amplitude));
        // Half the radius of the largest curvature, by a bound: the sphere's and the bumps'.
        const double low = radius - amplitude;
        mReach = 0.5 / (1 / low + 4 * amplitude * (bumps + 1) * (bumps + 1) / (low * low));
    }

    double distance(const Vec3d& p) const override
    {
        const double length = p.norm();
        const double low = bound(p);
        if (std::abs(low) > mReach) return low;
        const double offset = length - shell(p / length).radius;
        // At this distance the surface is flat: the error is below offset^2 x curvature.
        if (std::abs(offset) < 1e-7 * mRadius) return offset * shellNormal(p).dot(p) / length;
        const double exact = (p - foot(p)).norm();
        return exact < mReach ? std::copysign(exact, offset) : low;
    }

    double bound(const Vec3d& p) const override
    {
        const double length = p.norm();
        if (length < mRadius - 2 * mAmplitude) return length - (mRadius - mAmplitude);
        const double outermost = length - (mRadius + mAmplitude);
        if (outermost > mReach) return outermost;
        return (length - shell(p / length).radius) / mSteepest;
    }

    bool isExact() const override { return false; }

    Vec3d normal(const Vec3d& p) const override
    {
        return shellNormal(std::abs(bound(p)) > mReach ? p : foot(p));
    }

    Box3d bounds() const override
    {
        const Vec3d half = Vec3d::Constant(mRadius + mAmplitude);
        return Box3d(-half, half);
    }

private:
    struct Shell {
        double radius;  ///< of the surface along u
        Vec3d gradient; ///< of radius by u, tangential
    };
    Shell shell(const Vec3d& u) const
    {
        const Eigen::Array3d angle = mBumps * u.array();
        const Eigen::Array3d s = angle.sin(), c = mBumps * angle.cos();
        const Vec3d g(c.x() * s.y() * s.z(), s.x() * c.y() * s.z(), s.x() * s.y() * c.z());
        return {mRadius + mAmplitude * s.prod(), mAmplitude * (g - g.dot(u) * u)};
    }
    /// The normal of the surface |p| - radius = constant through @a p.
    Vec3d shellNormal(const Vec3d& p) const
    {
        const double length = p.norm();
        const Vec3d u = p / length;
        return (u - shell(u).gradient / length).normalized();
    }
    /// The nearest surface point of a @a p near the surface: slides along the tangent plane towards
    /// p and projects back onto the surface until p is straight above. The slide contracts by
    /// distance x curvature, at most one half within the reach.
    Vec3d foot(const Vec3d& p) const
    {
        constexpr int kMaxSteps = 30; // [derived: slides halve; 2^-30 errs by a double's rounding]
        constexpr double kMaxSlide2 = 1e-14; // squared, in reaches [derived: so errs the distance]
        Vec3d u = p.normalized();
        Shell s = shell(u);
        Vec3d q = s.radius * u;
        for (int i = 0; i < kMaxSteps; ++i) {
            const Vec3d n = (u - s.gradient / s.radius).normalized();
            const Vec3d away = p - q;
            const Vec3d slide = away - away.dot(n) * n;
            if (slide.squaredNorm() < kMaxSlide2 * mReach * mReach) break;
            u = (q + slide).normalized();
            s = shell(u);
            q = s.radius * u;
        }
        return q;
    }

    double mRadius, mBumps, mAmplitude, mSteepest, mReach;
};

} // namespace

SolidPtr makeBlob(double radius, double bumps, double amplitude)
{
    return std::make_shared<Blob>(radius, bumps, amplitude);
}

} // namespace mpuvdb
