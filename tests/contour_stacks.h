// Points of solids as slices and scan lines give them: many along a line, and few lines.
#pragma once
#include <mpuvdb/scan_sampler.h>

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <vector>

namespace mpuvdb::test
{

/// A tube about an arc of 200 degrees and radius 1 in the xy-plane, with round ends.
class BentTube : public Solid
{
public:
    double distance(const Vec3d& p) const override { return (p - nearest(p)).norm() - kRadius; }
    Vec3d normal(const Vec3d& p) const override { return (p - nearest(p)).normalized(); }
    Box3d bounds() const override
    {
        const double reach = 1 + kRadius;
        return {Vec3d(-reach, -reach, -kRadius), Vec3d(reach, reach, kRadius)};
    }
    static double volume() { return M_PI * kRadius * kRadius * (2 * kHalf + 4.0 / 3 * kRadius); }

private:
    static constexpr double kRadius = 0.25, kHalf = 100 * M_PI / 180;

    static Vec3d nearest(const Vec3d& p)
    {
        const double angle = std::clamp(std::atan2(p.y(), p.x()), -kHalf, kHalf);
        return {std::cos(angle), std::sin(angle), 0};
    }
};

/// Follows the contour of a smooth solid in a plane, from place to place.
class Contour
{
public:
    /// @param axes  orthonormal; contours lie across the third, and places are along them.
    Contour(const Solid& solid, const Eigen::Matrix3d& axes)
        : mSolid(solid), mAxes(axes), mMiddle(solid.bounds().center())
    {
    }

    Vec3d world(const Vec3d& place) const { return mMiddle + mAxes * place; }
    double distance(const Vec3d& place) const { return mSolid.distance(world(place)); }
    /// The nearest place on the contour, within @a most.
    Vec3d project(Vec3d place, double most) const
    {
        for (int round = 0; round < 8; ++round) {
            const Vec3d gradient = across(place);
            const double step = std::clamp(distance(place), -most, most);
            place -= step / std::max(gradient.squaredNorm(), 1e-3) * gradient;
        }
        return place;
    }
    /// Append places @a along apart, from @a start round to it.
    void follow(Vec3d start, double along, std::vector<Vec3d>& line) const
    {
        constexpr int kMost = 5000;
        start = project(start, along);
        Vec3d place = start;
        for (int n = 0; n < kMost && (n < 3 || (place - start).norm() > 0.7 * along); ++n) {
            line.push_back(place);
            const Vec3d out = across(place);
            place = project(place + along * Vec3d(-out.y(), out.x(), 0).normalized(), along);
        }
    }

private:
    /// The normal, as far as it lies in the plane.
    Vec3d across(const Vec3d& place) const
    {
        const Vec3d normal = mAxes.transpose() * mSolid.normal(world(place));
        return {normal.x(), normal.y(), 0};
    }

    const Solid& mSolid;
    const Eigen::Matrix3d mAxes;
    const Vec3d mMiddle;
};

/// The contours of @a solid in planes @a apart, their points @a along apart, with normals.
inline PointCloud contourStack(const Solid& solid, const Eigen::Matrix3d& axes, double apart,
                               double along)
{
    PointCloud cloud;
    const Contour contour(solid, axes);
    const double reach = solid.bounds().sizes().norm() / 2;
    for (double z = -reach + 0.37 * apart; z < reach; z += apart) {
        std::vector<Vec3d> line;
        const auto isNew = [&](const Vec3d& p) {
            return std::none_of(line.begin(), line.end(),
                                [&](const Vec3d& q) { return (p - q).norm() < 3 * along; });
        };
        for (double y = -reach; y < reach; y += 2 * along)
            for (double x = -reach; x < reach; x += along) {
                const Vec3d from(x, y, z), to(x + along, y, z);
                if ((contour.distance(from) < 0) == (contour.distance(to) < 0)) continue;
                if (isNew(contour.project(from, along))) contour.follow(from, along, line);
            }
        for (const Vec3d& place : line) {
            const Vec3d p = contour.world(place);
            cloud.positions.push_back(p.cast<float>());
            cloud.normals.push_back(solid.normal(p).cast<float>());
        }
    }
    return cloud;
}

/// Stacks along z, along x, and in a direction that is none of the axes'.
inline std::vector<Eigen::Matrix3d> stackDirections()
{
    const auto turned = [](double angle, const Vec3d& axis) {
        return Eigen::AngleAxisd(angle, axis.normalized()).toRotationMatrix();
    };
    return {Eigen::Matrix3d::Identity(), turned(M_PI / 2, Vec3d::UnitY()),
            turned(0.7, Vec3d(1, 2, 0.5))};
}

} // namespace mpuvdb::test
