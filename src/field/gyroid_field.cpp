// The wall about a gyroid, by distances from it.
#include "point_field.h"
#include "spatial/kd_tree.h"
#include <mpuvdb/error.h>

#include <Eigen/LU>

#include <array>
#include <cmath>
#include <fmt/format.h>

namespace mpuvdb
{
namespace
{

/// The largest distance from a gyroid, periods. [derived: that of (1/4, 1/8, 0), about which none
/// of 0.4 million random places is farther]
constexpr double kFarthest = 0.2296578;

/// G = sin x cos y + sin y cos z + sin z cos x about a place, whose angles are x, y and z.
struct GyroidValue {
    double value;
    Vec3d gradient;
    Eigen::Matrix3d hessian;

    explicit GyroidValue(const Vec3d& angles)
    {
        const Eigen::Array3d s = angles.array().sin(), c = angles.array().cos();
        value = s[0] * c[1] + s[1] * c[2] + s[2] * c[0];
        gradient = {c[0] * c[1] - s[2] * s[0], c[1] * c[2] - s[0] * s[1],
                    c[2] * c[0] - s[1] * s[2]};
        const double xy = -c[0] * s[1], yz = -c[1] * s[2], zx = -c[2] * s[0];
        hessian << -s[0] * c[1] - s[2] * c[0], xy, zx, //
            xy, -s[1] * c[2] - s[0] * c[1], yz,        //
            zx, yz, -s[2] * c[0] - s[1] * c[2];
    }
};

/// The surface G = 0 of period 2 pi.
class GyroidSurface
{
public:
    /// The only one, made when it is first asked for.
    static const GyroidSurface& get()
    {
        static const GyroidSurface surface;
        return surface;
    }

    /// The vector from the nearest place of the surface to the place of @a angles.
    Vec3d offset(const Vec3d& angles) const
    {
        const Vec3d p = angles - kPeriod * (angles / kPeriod).array().floor().matrix();
        std::vector<std::uint32_t> nearest(kCandidates);
        std::vector<float> squared(kCandidates);
        mTree.nearest(p.cast<float>(), nearest, squared);
        const double apart = kApart * kPeriod, farthest = double(squared[0]) + apart * apart;
        Vec3d offset = p - mPlaces[nearest[0]].cast<double>();
        for (std::size_t n = 0; n < nearest.size() && double(squared[n]) <= farthest; ++n) {
            const Vec3d place = mPlaces[nearest[n]].cast<double>();
            const bool isBeside = (p - offset - place).norm() < 2 * apart; // of the same part
            if (n > 0 && isBeside) continue;
            const Vec3d other = p - footOf(p, place);
            if (other.squaredNorm() <= offset.squaredNorm()) offset = other;
        }
        return offset;
    }

private:
    static constexpr double kPeriod = 2 * M_PI; ///< [derived: that of a sine]
    /// Places by which the nearest part of the surface is found lie about as far apart, periods.
    /// [derived: within it the surface turns by less than an eighth of a circle, from where
    /// Newton's method finds the foot]
    static constexpr double kApart = 1.0 / 48;
    /// Places that are looked at. [derived: of those of a part that is as near as another one, all
    /// that are nearer than any of that lie within about kApart of its foot, and are fewer]
    static constexpr std::size_t kCandidates = 8;

    GyroidSurface() : mPlaces(placesOnIt()), mTree(mPlaces) {}

    /// Those of a period, and as far around it as the nearest one may lie.
    static std::vector<Vec3f> placesOnIt()
    {
        const double step = kPeriod * kApart;
        const int first = -int(std::ceil((kFarthest + kApart) / kApart)),
                  end = int(std::round(1 / kApart)) - first;
        std::vector<Vec3f> places;
        for (int x = first; x < end; ++x)
            for (int y = first; y < end; ++y)
                for (int z = first; z < end; ++z) {
                    const Vec3d p = step * Vec3d(x + 0.5, y + 0.5, z + 0.5);
                    const GyroidValue at(p);
                    // The surface is no farther than that along the gradient, by an eighth.
                    const double slope = at.gradient.norm();
                    if (std::abs(at.value) > slope * step) continue;
                    places.push_back(projected(p).cast<float>());
                }
        return places;
    }
    /// The place of the surface to which the gradient leads from @a p, which is near it.
    static Vec3d projected(Vec3d p)
    {
        for (int n = 0; n < kRounds; ++n) {
            const GyroidValue at(p);
            p -= at.value / at.gradient.squaredNorm() * at.gradient;
        }
        return p;
    }
    /// The place of the surface from which a normal leads to @a p, beside the place @a q of it.
    static Vec3d footOf(const Vec3d& p, Vec3d q)
    {
        const GyroidValue first(q);
        double along = first.gradient.dot(p - q) / first.gradient.squaredNorm();
        for (int n = 0; n < kRounds; ++n) {
            const GyroidValue at(q);
            Eigen::Matrix4d matrix = Eigen::Matrix4d::Zero();
            matrix.topLeftCorner<3, 3>() = Eigen::Matrix3d::Identity() + along * at.hessian;
            matrix.topRightCorner<3, 1>() = at.gradient;
            matrix.bottomLeftCorner<1, 3>() = at.gradient.transpose();
            Eigen::Vector4d rest;
            rest << p - q - along * at.gradient, -at.value;
            const Eigen::Vector4d change = matrix.partialPivLu().solve(rest);
            q += change.head<3>();
            along += change[3];
        }
        return projected(q);
    }
    /// Rounds of Newton's method. [derived: each squares the error, a hundredth of a period at
    /// first, so that four reach double's rounding]
    static constexpr int kRounds = 4;

    std::vector<Vec3f> mPlaces;
    KdTree mTree;
};

class GyroidField final : public PointField
{
public:
    GyroidField(double period, double thickness)
        : mFrequency(2 * M_PI / period), mHalf(thickness / 2), mSurface(GyroidSurface::get())
    {
    }

    Box3d bounds() const override { return wholeSpace(); }
    FieldSample evaluate(const Vec3d& p) const override
    {
        const Vec3d angles = mFrequency * p, offset = mSurface.offset(angles);
        const double distance = offset.norm();
        // On the surface its own normal, to one side.
        const Vec3d gradient = distance > kRelativeStep ? Vec3d(offset / distance)
                                                        : GyroidValue(angles).gradient.normalized();
        return {distance / mFrequency - mHalf, gradient, -1, true};
    }
    double value(const Vec3d& p) const override
    {
        return mSurface.offset(mFrequency * p).norm() / mFrequency - mHalf;
    }
    /// Inside thick walls, whose faces have creases, it is none.
    bool isDistance() const override { return false; }

private:
    double mFrequency, mHalf;
    const GyroidSurface& mSurface;
};

} // namespace

FieldPtr makeGyroid(double period, double thickness)
{
    if (!(period > 0) || !std::isfinite(period))
        throw UsageError(fmt::format("gyroid: its period is {}; it must be above 0", period));
    const double most = 2 * kFarthest;
    if (!(thickness > 0 && thickness < most * period))
        throw UsageError(fmt::format("gyroid: its thickness is {}; it must be above 0 and below "
                                     "{:.3g}, {:.3g} of its period: thicker walls fill all space",
                                     thickness, most * period, most));
    return std::make_shared<GyroidField>(period, thickness);
}

} // namespace mpuvdb
