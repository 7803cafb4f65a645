// Crossings of straight lines and the surface of a solid.
#pragma once
#include <mpuvdb/scan_sampler.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

namespace mpuvdb
{

/// Marches along lines by the distance, a lower bound of that to the surface, and locates every
/// change of sign to the last bits. Pairs of crossings less than 1e-5 of the box's diagonal apart
/// may be missed: of grazing lines, or of walls thinner than that.
class LineTracer
{
public:
    explicit LineTracer(const Solid& solid)
        : mSolid(solid), mBox(solid.bounds()), mMinStep(1e-5 * mBox.diagonal().norm()),
          mRounding(2e-16 * (mBox.diagonal().norm() + mBox.center().norm()))
    {
        // The surface may touch the box: start outside.
        mBox.extend(mBox.min() - Vec3d::Constant(mMinStep));
        mBox.extend(mBox.max() + Vec3d::Constant(mMinStep));
    }

    const Solid& solid() const { return mSolid; }

    /// The parameters t of all crossings of the line origin + t * direction (a unit vector),
    /// rising.
    void crossings(const Vec3d& origin, const Vec3d& direction, std::vector<double>& out) const
    {
        out.clear();
        march(origin, direction, -HUGE_VAL, [&](double t) {
            out.push_back(t);
            return true;
        });
    }

    /// The parameter t of the first crossing with t >= 0.
    std::optional<double> firstHit(const Vec3d& origin, const Vec3d& direction) const
    {
        std::optional<double> hit;
        march(origin, direction, 0, [&](double t) {
            hit = t;
            return false;
        });
        return hit;
    }

private:
    template <class Visit>
    void march(const Vec3d& origin, const Vec3d& direction, double first, Visit&& visit) const
    {
        double t = first, end = HUGE_VAL;
        for (int axis = 0; axis < 3; ++axis) {
            // A line within a face's plane gives NaN, which min and max ignore here.
            const double a = (mBox.min()[axis] - origin[axis]) / direction[axis];
            const double b = (mBox.max()[axis] - origin[axis]) / direction[axis];
            t = std::max(t, std::min(a, b));
            end = std::min(end, std::max(a, b));
        }
        if (!(t < end)) return;
        double value = mSolid.bound(origin + t * direction), slope = -1;
        while (t < end) {
            // If the value goes on as it went, the next free ball just touches this one
            // [Balint18]; if the two do not meet after all, step within this one.
            constexpr double kRelaxation = 0.98; // part of such a step [tuned: scan_sampler_test]
            const double free = std::abs(value);
            double step = std::max(free * kRelaxation * 2 / (1 - std::min(slope, 0.9)), mMinStep);
            double nextValue = mSolid.bound(origin + (t + step) * direction);
            const bool covered =
                (value < 0) == (nextValue < 0) && step <= free + std::abs(nextValue);
            if (!covered && step > std::max(free, mMinStep)) {
                step = std::max(free, mMinStep);
                nextValue = mSolid.bound(origin + (t + step) * direction);
            }
            const double next = t + step;
            const bool crossed = (value < 0) != (nextValue < 0);
            if (crossed && !visit(crossing(origin, direction, t, value, next, nextValue))) return;
            slope = crossed ? 0.0 : std::max((std::abs(nextValue) - free) / step, -1.0);
            t = next;
            value = nextValue;
        }
    }

    /// The root in [a,b], by false position that halves the stale end's weight [Dowell71:
    /// Illinois].
    double crossing(const Vec3d& origin, const Vec3d& direction, double a, double fa, double b,
                    double fb) const
    {
        constexpr int kMaxSteps = 100; // [derived: above the 64 of bisection of a double]
        double best = std::abs(fa) < std::abs(fb) ? a : b;
        double bestValue = std::min(std::abs(fa), std::abs(fb));
        int side = 0;
        for (int i = 0; i < kMaxSteps && bestValue > mRounding; ++i) {
            double t = (a * fb - b * fa) / (fb - fa);
            if (!(t > a && t < b)) t = (a + b) / 2;
            if (!(t > a && t < b)) break;
            const double f = mSolid.bound(origin + t * direction);
            if (std::abs(f) < bestValue) {
                best = t;
                bestValue = std::abs(f);
            }
            if ((f < 0) == (fb < 0)) {
                b = t;
                fb = f;
                if (side < 0) fa /= 2;
                side = -1;
            } else {
                a = t;
                fa = f;
                if (side > 0) fb /= 2;
                side = 1;
            }
        }
        return best;
    }

    const Solid& mSolid;
    Box3d mBox;
    double mMinStep;
    double mRounding; ///< rounding error of distances, world units
};

} // namespace mpuvdb
