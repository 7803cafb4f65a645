// Primitives with exact signed distances.
#include "solids.h"

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

/// A vector of the positive octant, mirrored into the octant of @a signs.
Vec3d withSigns(const Vec3d& magnitude, const Vec3d& signs)
{
    return {std::copysign(magnitude.x(), signs.x()), std::copysign(magnitude.y(), signs.y()),
            std::copysign(magnitude.z(), signs.z())};
}

Vec3d normalizedOr(const Vec3d& v, const Vec3d& fallback)
{
    const double length = v.norm();
    return length > 0 ? Vec3d(v / length) : fallback;
}

/// The vector (rho, z) of the half plane through @a p and the z axis.
Vec3d fromProfile(double rho, double z, const Vec3d& p)
{
    const double length = p.head<2>().norm();
    const Vec3d out = length > 0 ? Vec3d(p.x() / length, p.y() / length, 0) : Vec3d::UnitX();
    return rho * out + z * Vec3d::UnitZ();
}

/// Distance and gradient of a box corner: @a q is the position relative to the corner, per axis
/// positive outside.
template <int N>
double cornerDistance(const Eigen::Matrix<double, N, 1>& q)
{
    return q.cwiseMax(0).norm() + std::min(q.maxCoeff(), 0.0);
}

template <int N>
Eigen::Matrix<double, N, 1> cornerGradient(const Eigen::Matrix<double, N, 1>& q)
{
    const Eigen::Matrix<double, N, 1> outside = q.cwiseMax(0);
    const double length = outside.norm();
    if (length > 0) return outside / length;
    Eigen::Index axis = 0;
    q.maxCoeff(&axis);
    return Eigen::Matrix<double, N, 1>::Unit(axis);
}

Box3d boxAbout(const Vec3d& half)
{
    return Box3d(-half, half);
}

class Sphere final : public Solid
{
public:
    explicit Sphere(double radius) : mRadius(radius) {}
    double distance(const Vec3d& p) const override { return p.norm() - mRadius; }
    Vec3d normal(const Vec3d& p) const override { return normalizedOr(p, Vec3d::UnitZ()); }
    Box3d bounds() const override { return boxAbout(Vec3d::Constant(mRadius)); }

private:
    double mRadius;
};

class Torus final : public Solid
{
public:
    Torus(double major, double minor) : mMajor(major), mMinor(minor) {}
    double distance(const Vec3d& p) const override
    {
        return Eigen::Vector2d(p.head<2>().norm() - mMajor, p.z()).norm() - mMinor;
    }
    Vec3d normal(const Vec3d& p) const override
    {
        const double rho = p.head<2>().norm() - mMajor;
        return normalizedOr(fromProfile(rho, p.z(), p), Vec3d::UnitZ());
    }
    Box3d bounds() const override { return boxAbout({mMajor + mMinor, mMajor + mMinor, mMinor}); }

private:
    double mMajor, mMinor;
};

class RoundedBox final : public Solid
{
public:
    RoundedBox(const Vec3d& size, double radius) : mHalf(size / 2), mRadius(radius) {}
    double distance(const Vec3d& p) const override { return cornerDistance(corner(p)) - mRadius; }
    Vec3d normal(const Vec3d& p) const override { return withSigns(cornerGradient(corner(p)), p); }
    Box3d bounds() const override { return boxAbout(mHalf); }

private:
    Vec3d corner(const Vec3d& p) const { return p.cwiseAbs() - (mHalf - Vec3d::Constant(mRadius)); }
    Vec3d mHalf;
    double mRadius;
};

class Capsule final : public Solid
{
public:
    Capsule(double radius, double length) : mRadius(radius), mHalf(length / 2) {}
    double distance(const Vec3d& p) const override { return fromAxis(p).norm() - mRadius; }
    Vec3d normal(const Vec3d& p) const override
    {
        return normalizedOr(fromAxis(p), Vec3d::UnitX());
    }
    Box3d bounds() const override { return boxAbout({mRadius, mRadius, mHalf + mRadius}); }

private:
    Vec3d fromAxis(const Vec3d& p) const
    {
        return {p.x(), p.y(), p.z() - std::clamp(p.z(), -mHalf, mHalf)};
    }
    double mRadius, mHalf;
};

class Cylinder final : public Solid
{
public:
    Cylinder(double radius, double height) : mRadius(radius), mHalf(height / 2) {}
    double distance(const Vec3d& p) const override { return cornerDistance(corner(p)); }
    Vec3d normal(const Vec3d& p) const override
    {
        const Eigen::Vector2d g = cornerGradient(corner(p));
        return fromProfile(g.x(), std::copysign(g.y(), p.z()), p);
    }
    Box3d bounds() const override { return boxAbout({mRadius, mRadius, mHalf}); }

private:
    Eigen::Vector2d corner(const Vec3d& p) const
    {
        return {p.head<2>().norm() - mRadius, std::abs(p.z()) - mHalf};
    }
    double mRadius, mHalf;
};

class Cone final : public Solid
{
public:
    Cone(double radius, double height)
        : mRadius(radius), mHalf(height / 2),
          mSlope(Eigen::Vector2d(height, radius).normalized()) // outward normal of the side
    {
    }
    double distance(const Vec3d& p) const override
    {
        const Foot f = nearest(p);
        return std::copysign(f.away.norm(), f.inside ? -1.0 : 1.0);
    }
    Vec3d normal(const Vec3d& p) const override
    {
        const Foot f = nearest(p);
        const double length = f.away.norm();
        // On the surface rounding hides the direction to the foot: the face's own normal.
        const Eigen::Vector2d n = length > 1e-9 * mRadius
                                      ? Eigen::Vector2d(f.away / (f.inside ? -length : length))
                                      : f.faceNormal;
        return fromProfile(n.x(), n.y(), p);
    }
    Box3d bounds() const override { return boxAbout({mRadius, mRadius, mHalf}); }

private:
    struct Foot {
        Eigen::Vector2d away; ///< from the nearest surface point of the profile
        Eigen::Vector2d faceNormal;
        bool inside;
    };
    Foot nearest(const Vec3d& p) const
    {
        const Eigen::Vector2d q(p.head<2>().norm(), p.z());
        const Eigen::Vector2d base(std::min(q.x(), mRadius), -mHalf), apex(0, mHalf);
        const Eigen::Vector2d side = Eigen::Vector2d(mRadius, -mHalf) - apex;
        const double along = std::clamp((q - apex).dot(side) / side.squaredNorm(), 0.0, 1.0);
        const Eigen::Vector2d toBase = q - base, toSide = q - apex - along * side;
        const bool inside = q.y() > -mHalf && (q - apex).dot(mSlope) < 0;
        if (toBase.squaredNorm() < toSide.squaredNorm()) return {toBase, {0, -1}, inside};
        return {toSide, mSlope, inside};
    }
    double mRadius, mHalf;
    Eigen::Vector2d mSlope;
};

/// An ellipsoid. The nearest point x of the surface satisfies p - x = t grad(x^2/r^2) / 2, so x_i =
/// r_i^2 p_i / (t + r_i^2) with the largest t for which x lies on the surface.
class Ellipsoid final : public Solid
{
public:
    explicit Ellipsoid(const Vec3d& radii) : mRadii(radii)
    {
        mRadii.minCoeff(&mShort);
        // r_i^2 - r_short^2, without cancellation.
        mExcess = (mRadii.array() - mRadii[mShort]) * (mRadii.array() + mRadii[mShort]);
    }
    double distance(const Vec3d& p) const override
    {
        const double away = (p.cwiseAbs() - foot(p.cwiseAbs())).norm();
        return p.cwiseQuotient(mRadii).squaredNorm() < 1 ? -away : away;
    }
    Vec3d normal(const Vec3d& p) const override
    {
        const Vec3d x = foot(p.cwiseAbs());
        return withSigns((x.array() / mRadii.array().square()).matrix().normalized(), p);
    }
    Box3d bounds() const override { return boxAbout(mRadii); }

private:
    /// The nearest surface point of a point in the positive octant.
    Vec3d foot(const Vec3d& p) const
    {
        // u = t + r_short^2 avoids cancellation. The sum of squares below is at least 1 at the
        // start; 1 / sqrt(sum) is convex, so Newton's steps approach its 1 from one side.
        const Eigen::Array3d scaled = mRadii.array() * p.array();
        double u = std::max((scaled - mExcess).maxCoeff(), 0.0);
        constexpr int kMaxSteps = 60; // fewer than ten are usual [derived: a double's bits]
        for (int step = 0; step < kMaxSteps; ++step) {
            double sum = 0, slope = 0;
            for (int i = 0; i < 3; ++i) {
                if (!(scaled[i] > 0)) continue;
                const double bottom = u + mExcess[i], term = scaled[i] / bottom;
                sum += term * term;
                slope += term * term / bottom;
            }
            if (!(sum > 1)) break;
            const double next = u + sum * (std::sqrt(sum) - 1) / slope;
            if (!(next > u)) break;
            u = next;
        }
        Vec3d x = Vec3d::Zero();
        for (int i = 0; i < 3; ++i)
            if (scaled[i] > 0) x[i] = mRadii[i] * scaled[i] / (u + mExcess[i]);
        // From the middle plane, inside the focal curve, the surface is met along the short axis.
        if (!(scaled[mShort] > 0)) {
            const double rest = 1 - x.cwiseQuotient(mRadii).squaredNorm();
            if (rest > 0) x[mShort] = mRadii[mShort] * std::sqrt(rest);
        }
        return x;
    }

    Vec3d mRadii;
    Eigen::Index mShort = 0;
    Eigen::Array3d mExcess;
};

} // namespace

SolidPtr makeSphere(double radius)
{
    return std::make_shared<Sphere>(radius);
}
SolidPtr makeTorus(double major, double minor)
{
    return std::make_shared<Torus>(major, minor);
}
SolidPtr makeBox(const Vec3d& size, double radius)
{
    return std::make_shared<RoundedBox>(size, radius);
}
SolidPtr makeEllipsoid(const Vec3d& radii)
{
    return std::make_shared<Ellipsoid>(radii);
}
SolidPtr makeCapsule(double radius, double length)
{
    return std::make_shared<Capsule>(radius, length);
}
SolidPtr makeCylinder(double radius, double height)
{
    return std::make_shared<Cylinder>(radius, height);
}
SolidPtr makeCone(double radius, double height)
{
    return std::make_shared<Cone>(radius, height);
}

} // namespace mpuvdb
