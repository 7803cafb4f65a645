#include "validate_solids.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <stdexcept>

namespace validate
{
namespace
{

constexpr double kPi = 3.14159265358979323846;

/// No solid stands along the axes: lattices would fit it too well.
const Eigen::Matrix3d& standing()
{
    static const Eigen::Matrix3d turned =
        Eigen::AngleAxisd(0.83, Vec3(0.48, -0.6, 0.64).normalized()).toRotationMatrix();
    return turned;
}

Box turnedBox(const Vec3& half)
{
    const Vec3 turned = standing().cwiseAbs() * half;
    return Box(-turned, turned);
}

/// A function in axes of its own, turned.
class Turned final : public Implicit
{
public:
    using Function = std::function<double(const Vec3&)>;

    /// @param half  of the box about the origin that holds the solid as it was.
    Turned(Function function, bool isDistance, const Vec3& half)
        : mFunction(std::move(function)), mIsDistance(isDistance), mBox(turnedBox(half))
    {
    }
    double value(const Vec3& p) const override { return mFunction(standing().transpose() * p); }
    bool isDistance() const override { return mIsDistance; }
    Box bounds() const override { return mBox; }

private:
    Function mFunction;
    bool mIsDistance;
    Box mBox;
};

/// A curve, and how far it is. With few samples to start from, Newton's method ends at the nearest
/// place for all points near a tube that does not touch itself.
class Curve
{
public:
    using Jet = std::array<Vec3, 3>; ///< place and its first two derivatives
    using Function = std::function<Jet(double)>;

    /// @param isClosed  the function goes on beyond both ends, along the same curve.
    Curve(Function function, double begin, double end, int samples, bool isClosed)
        : mFunction(std::move(function)), mBegin(begin), mEnd(end), mIsClosed(isClosed)
    {
        for (int n = 0; n <= samples; ++n) {
            mTimes.push_back(begin + (end - begin) * n / samples);
            mSamples.push_back(mFunction(mTimes.back())[0]);
        }
    }

    /// The place of the curve that is nearest to @a p.
    Vec3 nearest(const Vec3& p) const
    {
        std::size_t best = 0;
        for (std::size_t n = 1; n < mSamples.size(); ++n)
            if ((mSamples[n] - p).squaredNorm() < (mSamples[best] - p).squaredNorm()) best = n;
        const double step = mTimes[1] - mTimes[0];
        double t = mTimes[best];
        for (int n = 0; n < 8; ++n) {
            const auto [c, d, dd] = mFunction(t);
            const double slope = (c - p).dot(d), bend = d.squaredNorm() + (c - p).dot(dd);
            const double change = -slope / std::max(bend, 0.1 * d.squaredNorm());
            t += std::clamp(change, -step, step);
            if (!mIsClosed) t = std::clamp(t, mBegin, mEnd);
            if (std::abs(change) < 1e-12) break;
        }
        return mFunction(t)[0];
    }

private:
    Function mFunction;
    double mBegin, mEnd;
    bool mIsClosed;
    std::vector<double> mTimes;
    std::vector<Vec3> mSamples;
};

/// What is within a distance of a curve.
class Tube final : public Implicit
{
public:
    Tube(Curve curve, double radius, const Vec3& half)
        : mCurve(std::move(curve)), mRadius(radius), mBox(turnedBox(half))
    {
    }
    double value(const Vec3& p) const override { return across(p).norm() - mRadius; }
    Vec3 gradient(const Vec3& p) const override { return standing() * across(p).normalized(); }
    bool isDistance() const override { return true; }
    Box bounds() const override { return mBox; }

private:
    /// From the curve to @a p, in the curve's axes.
    Vec3 across(const Vec3& p) const
    {
        const Vec3 q = standing().transpose() * p;
        return q - mCurve.nearest(q);
    }

    Curve mCurve;
    double mRadius;
    Box mBox;
};

/// A tube along a trefoil knot.
std::shared_ptr<const Implicit> makeKnot()
{
    constexpr double kRadius = 0.4;
    const auto jet = [](double t) -> Curve::Jet {
        const double s1 = std::sin(t), c1 = std::cos(t), s2 = std::sin(2 * t), c2 = std::cos(2 * t),
                     s3 = std::sin(3 * t), c3 = std::cos(3 * t);
        return {Vec3(s1 + 2 * s2, c1 - 2 * c2, -s3), Vec3(c1 + 4 * c2, -s1 + 4 * s2, -3 * c3),
                Vec3(-s1 - 8 * s2, -c1 + 8 * c2, 9 * s3)};
    };
    return std::make_shared<Tube>(Curve(jet, 0, 2 * kPi, 120, true), kRadius, Vec3(3.5, 3.5, 1.5));
}

/// Four turns with round ends; the gap between two is half as wide as the wire.
std::shared_ptr<const Implicit> makeSpring()
{
    constexpr double kRadius = 0.18, kPitch = 0.54, kTurns = 4;
    const double climb = kPitch / (2 * kPi);
    const auto jet = [climb](double t) -> Curve::Jet {
        const double s = std::sin(t), c = std::cos(t);
        return {Vec3(c, s, climb * t), Vec3(-s, c, climb), Vec3(-c, -s, 0)};
    };
    return std::make_shared<Tube>(Curve(jet, -kTurns * kPi, kTurns * kPi, 160, false), kRadius,
                                  Vec3(1.2, 1.2, kTurns * kPitch / 2 + 0.2));
}

/// A box-like superellipsoid, twisted by half a turn.
std::shared_ptr<const Implicit> makeTwist()
{
    const auto value = [](const Vec3& p) {
        constexpr double kTwist = 1.2; // per world unit
        const double s = std::sin(kTwist * p.z()), c = std::cos(kTwist * p.z());
        const Eigen::Array3d q(c * p.x() + s * p.y(), (c * p.y() - s * p.x()) / 0.55, p.z() / 1.3);
        return 0.7 * (std::sqrt(std::sqrt(q.square().square().sum())) - 1);
    };
    return std::make_shared<Turned>(value, false, Vec3(1.2, 1.2, 1.35));
}

/// Goursat's quartic with eight bodies and twelve bridges: genus 5.
std::shared_ptr<const Implicit> makeTangle()
{
    const auto value = [](const Vec3& p) {
        const Eigen::Array3d squares = p.array().square();
        return ((squares * squares - 5 * squares).sum() + 11.8) / 12;
    };
    return std::make_shared<Turned>(value, false, Vec3::Constant(2.4));
}

/// A third of a sphere's shell with a round rim: two sheets close to each other.
std::shared_ptr<const Implicit> makeBowl()
{
    const auto value = [](const Vec3& p) {
        constexpr double kHalfWall = 0.03, kRim = 70 * kPi / 180;
        const double side = std::hypot(p.x(), p.y());
        if (std::atan2(side, -p.z()) < kRim) return std::abs(p.norm() - 1) - kHalfWall;
        return std::hypot(side - std::sin(kRim), p.z() + std::cos(kRim)) - kHalfWall;
    };
    return std::make_shared<Turned>(value, true, Vec3(1, 1, 1.04));
}

/// The part of a gyroid's one labyrinth that is within a ball, blended into it: genus 5.
std::shared_ptr<const Implicit> makeGyroid()
{
    const auto value = [](const Vec3& p) {
        constexpr double kWave = 5.6, kBlend = 0.2;
        const Eigen::Array3d s = (kWave * p.array()).sin(), c = (kWave * p.array()).cos();
        const double gyroid = (s[0] * c[1] + s[1] * c[2] + s[2] * c[0]) / (1.5 * kWave),
                     ball = p.norm() - 1;
        return (gyroid + ball + std::hypot(gyroid - ball, kBlend)) / 2;
    };
    return std::make_shared<Turned>(value, false, Vec3::Constant(1.02));
}

void addQuad(Triangles& mesh, std::array<std::uint32_t, 4> q)
{
    mesh.triangles.push_back({q[0], q[1], q[2]});
    mesh.triangles.push_back({q[0], q[2], q[3]});
}

/// A tapered ring between two polygons: edges of many angles, convex and reflex.
Triangles makePart()
{
    constexpr std::size_t kSides = 9;
    constexpr double kAngles[kSides] = {0, 35, 60, 100, 150, 185, 230, 290, 330};
    constexpr double kRadii[kSides] = {1, 0.9, 1.3, 0.8, 1.2, 1.15, 0.7, 1.25, 0.85};
    // Outside below and above, inside above and below: each ring's scale and height.
    constexpr double kRings[4][2] = {{1, -0.35}, {0.75, 0.35}, {0.5, 0.35}, {0.35, -0.35}};
    Triangles mesh;
    for (const auto& ring : kRings)
        for (std::size_t n = 0; n < kSides; ++n) {
            const double angle = kAngles[n] * kPi / 180, radius = ring[0] * kRadii[n];
            mesh.vertices.emplace_back(radius * std::cos(angle), radius * std::sin(angle), ring[1]);
        }
    for (std::uint32_t r = 0; r < 4; ++r)
        for (std::uint32_t n = 0; n < kSides; ++n) {
            const std::uint32_t next = (n + 1) % kSides, above = (r + 1) % 4;
            addQuad(mesh, {r * 9 + n, r * 9 + next, above * 9 + next, above * 9 + n});
        }
    return mesh;
}

/// Sums of lengths that take turns, from the middle.
std::vector<double> stations(int count, double thin, double wide)
{
    std::vector<double> result{0};
    for (int n = 0; n < count; ++n) result.push_back(result.back() + (n % 2 ? wide : thin));
    const double half = result.back() / 2;
    for (double& x : result) x -= half;
    return result;
}

/// Twelve nodes and twenty struts, sheared: genus 9.
Triangles makeLattice()
{
    constexpr std::array<int, 3> kCells{5, 3, 3};
    const std::vector<double> at[3] = {stations(5, 0.09, 0.5), stations(3, 0.09, 0.4),
                                       stations(3, 0.09, 0.45)};
    const auto isFull = [&](const Eigen::Array3i& c) {
        int odd = 0;
        for (int axis = 0; axis < 3; ++axis) {
            if (c[axis] < 0 || c[axis] >= kCells[axis]) return false;
            odd += c[axis] % 2;
        }
        return odd < 2;
    };
    Triangles mesh;
    std::map<std::array<int, 3>, std::uint32_t> known;
    const auto vertex = [&](const Eigen::Array3i& c) {
        const auto [found, isNew] =
            known.emplace(std::array<int, 3>{c[0], c[1], c[2]}, mesh.vertices.size());
        if (isNew) {
            const double x = at[0][c[0]], y = at[1][c[1]], z = at[2][c[2]];
            mesh.vertices.emplace_back(x + 0.25 * y, y + 0.15 * z, z);
        }
        return found->second;
    };
    for (int n = 0; n < kCells[0] * kCells[1] * kCells[2]; ++n) {
        const Eigen::Array3i c(n % 5, n / 5 % 3, n / 15);
        for (int axis = 0; isFull(c) && axis < 3; ++axis)
            for (const int side : {0, 1}) {
                Eigen::Array3i step = Eigen::Array3i::Zero(), u = step, v = step;
                step[axis] = side ? 1 : -1;
                if (isFull(c + step)) continue;
                u[(axis + (side ? 1 : 2)) % 3] = 1;
                v[(axis + (side ? 2 : 1)) % 3] = 1;
                const Eigen::Array3i base = side ? Eigen::Array3i(c + step) : c;
                addQuad(mesh,
                        {vertex(base), vertex(base + u), vertex(base + u + v), vertex(base + v)});
            }
    }
    return mesh;
}

using Maker = std::shared_ptr<const Implicit> (*)();
const std::map<std::string, Maker> kSmooth{{"twist", makeTwist},   {"knot", makeKnot},
                                           {"spring", makeSpring}, {"tangle", makeTangle},
                                           {"bowl", makeBowl},     {"gyroid", makeGyroid}};
const std::map<std::string, Triangles (*)()> kEdged{{"part", makePart}, {"lattice", makeLattice}};

} // namespace

Box Triangles::bounds() const
{
    Box box;
    for (const Vec3& p : vertices) box.extend(p);
    return box;
}

Vec3 Implicit::gradient(const Vec3& p) const
{
    constexpr double kStep = 2e-5; // world units; solids are about one in size
    Vec3 result;
    for (int axis = 0; axis < 3; ++axis) {
        const Vec3 step = kStep * Vec3::Unit(axis);
        result[axis] = (value(p + step) - value(p - step)) / (2 * kStep);
    }
    return result;
}

Vec3 Implicit::project(const Vec3& p) const
{
    constexpr double kEnough = 1e-11;
    Vec3 q = p;
    for (int n = 0; n < 8; ++n) {
        const double f = value(q);
        if (std::abs(f) < kEnough) break;
        const Vec3 g = gradient(q);
        q -= f / std::max(g.squaredNorm(), 1e-6) * g;
    }
    return q;
}

Vec3 Implicit::foot(const Vec3& p) const
{
    Vec3 q = project(p);
    for (int n = 0; n < 10 && !isDistance(); ++n) {
        const Vec3 normal = gradient(q).normalized(), away = p - q;
        const Vec3 slide = away - away.dot(normal) * normal;
        // The distance errs by the square of it.
        if (slide.norm() < 1e-3 * away.norm() + 1e-10) break;
        q = project(q + slide);
    }
    return q;
}

std::vector<std::string> solidNames()
{
    std::vector<std::string> names;
    for (const auto& entry : kSmooth) names.push_back(entry.first);
    for (const auto& entry : kEdged) names.push_back(entry.first);
    return names;
}

std::shared_ptr<const Implicit> makeImplicit(const std::string& name)
{
    if (const auto smooth = kSmooth.find(name); smooth != kSmooth.end()) return smooth->second();
    if (kEdged.count(name)) return nullptr;
    std::string all;
    for (const std::string& other : solidNames()) all += " " + other;
    throw std::runtime_error(name + ": is no solid of this set, which has" + all);
}

Truth makeTruth(const std::string& name, int resolution)
{
    Truth truth{makeImplicit(name), {}};
    if (truth.implicit) {
        const int finer = name == "bowl" ? 2 : 1; // its rim is round within a few cells
        truth.mesh = marchTetrahedra(*truth.implicit, finer * resolution);
    } else {
        truth.mesh = kEdged.at(name)();
        for (Vec3& p : truth.mesh.vertices) p = standing() * p;
    }
    return truth;
}

} // namespace validate
