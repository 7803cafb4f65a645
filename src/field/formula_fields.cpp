// Half-space, and any function.
#include "point_field.h"
#include <mpuvdb/error.h>

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace mpuvdb
{
namespace
{

class HalfSpace final : public PointField
{
public:
    HalfSpace(const Vec3d& point, const Vec3d& normal) : mPoint(point), mNormal(normal) {}

    Box3d bounds() const override { return wholeSpace(); }
    FieldSample evaluate(const Vec3d& p) const override { return {value(p), mNormal, -1, true}; }
    double value(const Vec3d& p) const override { return mNormal.dot(p - mPoint); }
    bool isDistanceFar() const override { return true; }

private:
    Vec3d mPoint, mNormal;
};

double requireFinite(double value, const Vec3d& p)
{
    /// Largest magnitude of a value. [derived: floats of it are finite]
    constexpr double kMaxMagnitude = 1e30;
    if (!std::isfinite(value))
        throw InputError(fmt::format("function: its value at ({}, {}, {}) is not finite. "
                                     "Make it finite within and around the bounds",
                                     p[0], p[1], p[2]));
    return std::clamp(value, -kMaxMagnitude, kMaxMagnitude);
}

/// max(f, s * distance from the bounds) with the steepness s. The zero set of f within the bounds
/// stays: f is no deeper than s times the distance from it.
class FunctionField : public PointField
{
public:
    FunctionField(std::function<double(const Vec3d&)> function, const Box3d& bounds,
                  double steepness)
        : mFunction(std::move(function)), mBounds(bounds), mSteepness(steepness)
    {
    }

    Box3d bounds() const override { return mBounds; }
    FieldSample evaluate(const Vec3d& p) const override
    {
        const double own = requireFinite(mFunction(p), p), cut = wall(p);
        if (cut > own) return {cut, mSteepness * boxNormal(mBounds, p), -1, true};
        return {own, slope(p, kRelativeStep * mBounds.diagonal().norm()), -1, true};
    }
    double value(const Vec3d& p) const override
    {
        return std::max(requireFinite(mFunction(p), p), wall(p));
    }
    bool isDistance() const override { return false; }
    double steepness() const override { return mSteepness; }

protected:
    double wall(const Vec3d& p) const { return mSteepness * boxDistance(mBounds, p); }

private:
    std::function<double(const Vec3d&)> mFunction;
    Box3d mBounds;
    double mSteepness;
};

double valueOfOne(const PointsFunction& function, const Vec3d& p)
{
    std::vector<double> values;
    function({p}, values);
    return values.front();
}

class BatchField final : public FunctionField
{
public:
    BatchField(const PointsFunction& function, const Box3d& bounds, double steepness)
        : FunctionField([function](const Vec3d& p) { return valueOfOne(function, p); }, bounds,
                        steepness),
          mFunction(function)
    {
    }

    void values(const std::vector<Vec3d>& points, std::vector<double>& values) const override
    {
        mFunction(points, values);
        for (std::size_t i = 0; i < points.size(); ++i)
            values[i] = std::max(requireFinite(values[i], points[i]), wall(points[i]));
    }
    bool inBatches() const override { return true; }

private:
    PointsFunction mFunction;
};

void requireFunction(bool function, const Box3d& bounds, double steepness)
{
    if (!function) throw UsageError("function: there is none to call. Give one");
    if (bounds.isEmpty() || !isFinite(bounds))
        throw UsageError("function: its bounds are empty or not finite. Give the box in which "
                         "the solid lies");
    if (!(steepness > 0) || !std::isfinite(steepness))
        throw UsageError(
            fmt::format("function: its steepness is {}; it must be above 0", steepness));
}

} // namespace

FieldPtr makeHalfSpace(const Vec3d& point, const Vec3d& normal)
{
    const double length = normal.norm();
    if (!(length > 0) || !std::isfinite(length) || !point.allFinite())
        throw UsageError("half-space: its point must be finite, its normal too, and not zero");
    return std::make_shared<HalfSpace>(point, normal / length);
}

FieldPtr makeFunctionField(std::function<double(const Vec3d&)> function, const Box3d& bounds,
                           double steepness)
{
    requireFunction(bool(function), bounds, steepness);
    return std::make_shared<FunctionField>(std::move(function), bounds, steepness);
}

FieldPtr makeFunctionField(PointsFunction function, const Box3d& bounds, double steepness)
{
    requireFunction(bool(function), bounds, steepness);
    const auto checked = [function](const std::vector<Vec3d>& points, std::vector<double>& values) {
        function(points, values);
        if (values.size() != points.size())
            throw InputError(fmt::format("function: it gave {} values for {} points. Give one for "
                                         "each",
                                         values.size(), points.size()));
    };
    return std::make_shared<BatchField>(checked, bounds, steepness);
}

} // namespace mpuvdb
