// Twist, bend and taper along an axis; user-defined warps.
#include <mpuvdb/error.h>
#include <mpuvdb/fields.h>

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <limits>

namespace mpuvdb
{
namespace
{

/// The largest singular value of [[a, s], [0, 1]] with a, s >= 0.
double norm2(double a, double s)
{
    const double sum = a * a + s * s + 1;
    return std::sqrt((sum + std::sqrt(std::max(sum * sum - 4 * a * a, 0.0))) / 2);
}

/// Coordinates with z along an axis and x towards a side.
class Frame
{
public:
    Frame(const Axis& axis, const Vec3d& side, const char* what) : mOrigin(axis.origin)
    {
        const Vec3d z = axis.direction.normalized();
        const Vec3d across = side - side.dot(z) * z;
        if (!(axis.direction.norm() > 0) || !axis.direction.allFinite() ||
            !axis.origin.allFinite() || !side.allFinite() || !(across.norm() > 1e-9 * side.norm()))
            throw UsageError(fmt::format("{}: its axis must be finite and not zero, and its side "
                                         "not along it",
                                         what));
        const Vec3d x = across.normalized();
        mTurn << x, z.cross(x), z;
    }
    Frame(const Axis& axis, const char* what) : Frame(axis, anyAcross(axis.direction), what) {}

    bool operator==(const Frame& other) const
    {
        return mOrigin == other.mOrigin && mTurn == other.mTurn;
    }
    Vec3d local(const Vec3d& p) const { return mTurn.transpose() * (p - mOrigin); }
    Vec3d world(const Vec3d& q) const { return mOrigin + mTurn * q; }
    /// A box around @a box in these coordinates.
    Box3d local(const Box3d& box) const
    {
        return turned(box, mTurn.transpose(), local(box.center()));
    }
    Box3d world(const Box3d& box) const { return turned(box, mTurn, world(box.center())); }

private:
    static Vec3d anyAcross(const Vec3d& direction)
    {
        Eigen::Index least = 0;
        direction.cwiseAbs().minCoeff(&least);
        return Vec3d::Unit(least);
    }
    static Box3d turned(const Box3d& box, const Eigen::Matrix3d& by, const Vec3d& center)
    {
        const Vec3d half = by.cwiseAbs() * (box.sizes() / 2);
        return Box3d(center - half, center + half);
    }

    Vec3d mOrigin;
    Eigen::Matrix3d mTurn;
};

/// Largest distance from the axis in @a box (local).
double largestRadius(const Box3d& box)
{
    return box.min().cwiseAbs().cwiseMax(box.max().cwiseAbs()).head<2>().norm();
}

Box3d cylinder(double radius, double low, double high)
{
    return Box3d(Vec3d(-radius, -radius, low), Vec3d(radius, radius, high));
}

Box3d ball(const Vec3d& center, double radius)
{
    return Box3d(center - Vec3d::Constant(radius), center + Vec3d::Constant(radius));
}

class Twist final : public Warp
{
public:
    Twist(const Frame& frame, double angle) : mFrame(frame), mAngle(angle) {}

    Vec3d inverse(const Vec3d& p) const override
    {
        const Vec3d q = mFrame.local(p);
        return mFrame.world(turned(q, -mAngle * q.z()));
    }
    Box3d image(const Box3d& box) const override
    {
        const Box3d from = mFrame.local(box);
        const Vec3d q = mFrame.local(Vec3d(box.center()));
        const double reach = stretchAt(largestRadius(from)) * box.diagonal().norm() / 2;
        const Box3d to = cylinder(largestRadius(from), from.min().z(), from.max().z())
                             .intersection(ball(turned(q, mAngle * q.z()), reach));
        return mFrame.world(to);
    }
    double stretch(const Box3d& image) const override
    {
        return stretchAt(largestRadius(mFrame.local(image)));
    }
    std::shared_ptr<const Warp> after(const Warp& first) const override
    {
        const auto* const twist = dynamic_cast<const Twist*>(&first);
        return twist && twist->mFrame == mFrame
                   ? std::make_shared<Twist>(mFrame, twist->mAngle + mAngle)
                   : nullptr;
    }

private:
    static Vec3d turned(const Vec3d& q, double angle)
    {
        const double c = std::cos(angle), s = std::sin(angle);
        return {c * q.x() - s * q.y(), s * q.x() + c * q.y(), q.z()};
    }
    /// Largest singular value at @a radius: that of a shear along the axis, there and back.
    double stretchAt(double radius) const { return norm2(1, std::abs(mAngle) * radius); }

    Frame mFrame;
    double mAngle;
};

/// What lies along the axis is rolled onto a circle in the plane of axis and side, with its center
/// at (radius, from).
class Bend final : public Warp
{
public:
    Bend(const Axis& axis, const Vec3d& side, double curvature, double from, double to)
        : mFrame(axis, curvature < 0 ? Vec3d(-side) : side, "bend"),
          mRadius(1 / std::abs(curvature)), mFrom(from), mLength(to - from)
    {
    }

    Vec3d inverse(const Vec3d& p) const override
    {
        const Vec3d q = mFrame.local(p);
        const double whole = mLength / mRadius;
        const double u = q.z() - mFrom, v = mRadius - q.x();
        double angle = std::atan2(u, v);
        // Beyond both ends the nearer one counts.
        const double opposite = whole / 2 - M_PI;
        if (angle < opposite) angle += 2 * M_PI;
        if (angle <= 0) return p;
        if (angle < whole)
            return mFrame.world(Vec3d(mRadius - std::hypot(u, v), q.y(), mFrom + angle * mRadius));
        const double c = std::cos(whole), s = std::sin(whole);
        return mFrame.world(
            Vec3d(mRadius - (c * v + s * u), q.y(), mFrom + mLength + c * u - s * v));
    }
    Box3d image(const Box3d& box) const override
    {
        const Box3d from = mFrame.local(box);
        const double outermost =
            std::max(std::abs(mRadius - from.min().x()), std::abs(mRadius - from.max().x()));
        const bool before = from.max().z() <= mFrom;
        const double factor = before ? 1 : std::max(1.0, outermost / mRadius);
        return mFrame.world(
            ball(forward(mFrame.local(Vec3d(box.center()))), factor * box.diagonal().norm() / 2));
    }
    double stretch(const Box3d& image) const override
    {
        const Box3d box = mFrame.local(image);
        if (box.max().z() <= mFrom && box.max().x() < mRadius) return 1;
        // The larger of two lower bounds of the distance from the circle's axis.
        const Vec3d q = mFrame.local(Vec3d(image.center()));
        const double middle = std::hypot(q.z() - mFrom, mRadius - q.x());
        const Vec3d axis(mRadius, q.y(), mFrom);
        const double nearest =
            std::max(middle - image.diagonal().norm() / 2, box.exteriorDistance(axis));
        return nearest > 0 ? std::max(1.0, mRadius / nearest)
                           : std::numeric_limits<double>::infinity();
    }

private:
    Vec3d forward(const Vec3d& q) const
    {
        const double along = q.z() - mFrom, bent = std::clamp(along, 0.0, mLength);
        const double angle = bent / mRadius, c = std::cos(angle), s = std::sin(angle);
        const double v = mRadius - q.x(), u = along - bent;
        return {mRadius - (c * v - s * u), q.y(), mFrom + s * v + c * u};
    }

    Frame mFrame;
    double mRadius, mFrom, mLength;
};

class Taper final : public Warp
{
public:
    Taper(const Axis& axis, double from, double to, double factorFrom, double factorTo)
        : mFrame(axis, "taper"), mFrom(from), mTo(to), mFactorFrom(factorFrom),
          mSlope((factorTo - factorFrom) / (to - from))
    {
    }

    Vec3d inverse(const Vec3d& p) const override
    {
        const Vec3d q = mFrame.local(p);
        const double f = factor(q.z());
        return mFrame.world(Vec3d(q.x() / f, q.y() / f, q.z()));
    }
    Box3d image(const Box3d& box) const override
    {
        const Box3d from = mFrame.local(box);
        const Vec3d q = mFrame.local(Vec3d(box.center()));
        const double f = factor(q.z());
        const Factors factors = factorsOf(from);
        const double reach =
            norm2(factors.high, largestRadius(from) * factors.slope) * box.diagonal().norm() / 2;
        const Box3d to =
            cylinder(factors.high * largestRadius(from), from.min().z(), from.max().z())
                .intersection(ball({f * q.x(), f * q.y(), q.z()}, reach));
        return mFrame.world(to);
    }
    double stretch(const Box3d& image) const override
    {
        const Box3d box = mFrame.local(image);
        const Factors factors = factorsOf(box);
        const double shear = largestRadius(box) * factors.slope / (factors.low * factors.low);
        return norm2(1 / factors.low, shear);
    }

private:
    struct Factors {
        double low, high, slope;
    };
    double factor(double z) const
    {
        return mFactorFrom + mSlope * (std::clamp(z, mFrom, mTo) - mFrom);
    }
    Factors factorsOf(const Box3d& box) const
    {
        const double low = box.min().z(), high = box.max().z();
        const double a = factor(low), b = factor(high);
        const bool constant = high <= mFrom || low >= mTo;
        return {std::min(a, b), std::max(a, b), constant ? 0 : std::abs(mSlope)};
    }

    Frame mFrame;
    double mFrom, mTo, mFactorFrom, mSlope;
};

class Identity final : public Warp
{
public:
    Vec3d inverse(const Vec3d& p) const override { return p; }
    Box3d image(const Box3d& box) const override { return box; }
    double stretch(const Box3d& /*image*/) const override { return 1; }
};

/// @return @a from, which is moved to @a p. @throws InputError unless it is finite; where @a p, a
/// corner of an infinite box, is not, neither need be.
const Vec3d& requireFinitePlace(const Vec3d& from, const Vec3d& p)
{
    if (from.allFinite() || !p.allFinite()) return from;
    throw InputError(fmt::format("warp: the place that ({}, {}, {}) comes from is not finite. Make "
                                 "it finite within and around the bounds",
                                 p[0], p[1], p[2]));
}

class UserWarp : public Warp
{
public:
    UserWarp(std::function<Vec3d(const Vec3d&)> inverse, std::function<Box3d(const Box3d&)> image,
             double stretch)
        : mInverse(std::move(inverse)), mImage(std::move(image)), mStretch(stretch)
    {
    }
    Vec3d inverse(const Vec3d& p) const override { return requireFinitePlace(mInverse(p), p); }
    Box3d image(const Box3d& box) const override { return mImage(box); }
    double stretch(const Box3d& /*image*/) const override { return mStretch; }

private:
    std::function<Vec3d(const Vec3d&)> mInverse;
    std::function<Box3d(const Box3d&)> mImage;
    double mStretch;
};

Vec3d inverseOfOne(const PlacesFunction& inverse, const Vec3d& p)
{
    std::vector<Vec3d> from;
    inverse({p}, from);
    return from.front();
}

class BatchWarp final : public UserWarp
{
public:
    BatchWarp(PlacesFunction inverse, std::function<Box3d(const Box3d&)> image, double stretch)
        : UserWarp([inverse](const Vec3d& p) { return inverseOfOne(inverse, p); }, std::move(image),
                   stretch),
          mInverses(std::move(inverse))
    {
    }
    void inverses(const std::vector<Vec3d>& points, std::vector<Vec3d>& from) const override
    {
        mInverses(points, from);
        for (std::size_t n = 0; n < points.size(); ++n) requireFinitePlace(from[n], points[n]);
    }
    bool inBatches() const override { return true; }

private:
    PlacesFunction mInverses;
};

void requireWarp(bool functions, double stretch)
{
    if (!functions) throw UsageError("warp: its inverse and its image must be functions");
    if (!(stretch > 0) || !std::isfinite(stretch))
        throw UsageError(fmt::format("warp: its stretch is {}; it must be above 0", stretch));
}

void requireRange(const char* what, double from, double to)
{
    if (!(from < to) || !std::isfinite(from) || !std::isfinite(to))
        throw UsageError(fmt::format("{}: it goes from {} to {} along the axis; the second must be "
                                     "the larger, and both finite",
                                     what, from, to));
}

} // namespace

std::shared_ptr<const Warp> makeTwist(const Axis& axis, double angle)
{
    if (!std::isfinite(angle))
        throw UsageError(
            fmt::format("twist: its angle per length is {}; it must be finite", angle));
    return std::make_shared<Twist>(Frame(axis, "twist"), angle);
}

std::shared_ptr<const Warp> makeBend(const Axis& axis, const Vec3d& side, double curvature,
                                     double from, double to)
{
    requireRange("bend", from, to);
    const double angle = std::abs(curvature) * (to - from);
    if (!(angle <= 2 * M_PI))
        throw UsageError(fmt::format("bend: a curvature of {} over a length of {} is more than a "
                                     "full circle. Bend a shorter part, or less",
                                     curvature, to - from));
    if (std::isfinite(1 / curvature))
        return std::make_shared<Bend>(axis, side, curvature, from, to);
    return std::make_shared<Identity>();
}

std::shared_ptr<const Warp> makeTaper(const Axis& axis, double from, double to, double factorFrom,
                                      double factorTo)
{
    requireRange("taper", from, to);
    const double ratio = factorTo / factorFrom;
    if (!(factorFrom > 0 && ratio > 0) || !std::isfinite(factorFrom) || !std::isfinite(ratio))
        throw UsageError(fmt::format("taper: its factors are {} and {}; they must be above 0",
                                     factorFrom, factorTo));
    return std::make_shared<Taper>(axis, from, to, factorFrom, factorTo);
}

std::shared_ptr<const Warp> makeWarp(std::function<Vec3d(const Vec3d&)> inverse,
                                     std::function<Box3d(const Box3d&)> image, double stretch)
{
    requireWarp(inverse && image, stretch);
    return std::make_shared<UserWarp>(std::move(inverse), std::move(image), stretch);
}

std::shared_ptr<const Warp> makeWarp(PlacesFunction inverse,
                                     std::function<Box3d(const Box3d&)> image, double stretch)
{
    requireWarp(inverse && image, stretch);
    const auto checked = [inverse](const std::vector<Vec3d>& points, std::vector<Vec3d>& from) {
        inverse(points, from);
        if (from.size() != points.size())
            throw InputError(fmt::format("warp: its inverse gave {} places for {} points. Give one "
                                         "for each",
                                         from.size(), points.size()));
    };
    return std::make_shared<BatchWarp>(checked, std::move(image), stretch);
}

void Warp::inverses(const std::vector<Vec3d>& points, std::vector<Vec3d>& from) const
{
    from.clear();
    for (const Vec3d& p : points) from.push_back(inverse(p));
}

} // namespace mpuvdb
