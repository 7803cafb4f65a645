// The union of two balls beside OpenVDB's, with and without its re-distancing: time and exactness.
// csg_bench [radius in voxels]; JSON on standard output.
#include "timing.h"

#include <mpuvdb/interrupter.h>
#include <mpuvdb/operations.h>

#include <fmt/format.h>
#include <openvdb/tools/Composite.h>
#include <openvdb/tools/LevelSetRebuild.h>
#include <openvdb/tools/LevelSetSphere.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <functional>

namespace
{

using openvdb::FloatGrid;
using openvdb::Vec3d;

struct Timing : bench::Times {
    FloatGrid::ConstPtr result;

    void run(const std::function<FloatGrid::ConstPtr()>& work)
    {
        add([&] { result = work(); });
    }
};

/// Two balls of one radius on the x axis.
struct Balls {
    double radius, apart;

    /// Exact distance to their union.
    double distance(const Vec3d& p) const
    {
        const double a = p.length() - radius, b = (p - Vec3d(apart, 0, 0)).length() - radius;
        const double half = 0.5 * apart, circle = std::sqrt(radius * radius - half * half);
        // The nearest places of both surfaces are inside the other ball.
        const auto isBuried = [&](const Vec3d& q, double center) {
            const Vec3d foot = q * (radius / q.length()) + Vec3d(center, 0, 0);
            return (foot[0] - half) * (half - center) > 0;
        };
        if (isBuried(p, 0) && isBuried(p - Vec3d(apart, 0, 0), apart))
            return -std::hypot(p[0] - half, std::hypot(p[1], p[2]) - circle);
        return std::min(a, b);
    }
};

void print(const char* name, const Timing& timing, const Balls& balls, bool isLast)
{
    double sum = 0, largest = 0;
    for (auto it = timing.result->cbeginValueOn(); it; ++it) {
        const double exact = balls.distance(it.getCoord().asVec3d());
        const double error = std::abs(double(*it) - std::max(-3.0, std::min(3.0, exact)));
        sum += error;
        largest = std::max(largest, error);
    }
    fmt::print("  \"{}\": {{\"seconds\": {:.4f}, \"cpuSeconds\": {:.4f}, \"activeVoxels\": {}, "
               "\"meanError\": {:.6f}, \"maxError\": {:.4f}}}{}\n",
               name, bench::least(timing.wall), bench::least(timing.cpu),
               timing.result->activeVoxelCount(), sum / double(timing.result->activeVoxelCount()),
               largest, isLast ? "" : ",");
}

} // namespace

int main(int argc, char** argv)
{
    openvdb::initialize();
    const double radius = argc > 1 ? std::atof(argv[1]) : 257;
    const Balls balls{radius, 1.2 * radius};
    const auto ball = [&](double x) {
        return openvdb::tools::createLevelSetSphere<FloatGrid>(
            float(radius), openvdb::Vec3f(float(x), 0, 0), 1, 3);
    };
    const FloatGrid::Ptr a = ball(0), b = ball(balls.apart);
    Timing copy, combined, rebuilt;
    for (int n = 0; n < 3; ++n) {
        copy.run([&] { return openvdb::tools::csgUnionCopy(*a, *b); });
        combined.run([&] {
            mpuvdb::Interrupter progress;
            return mpuvdb::combine(mpuvdb::Boolean::Union,
                                   {mpuvdb::LevelSet(a), mpuvdb::LevelSet(b)}, 0, &progress)
                .gridPtr();
        });
    }
    rebuilt.run([&] {
        return openvdb::tools::levelSetRebuild(*openvdb::tools::csgUnionCopy(*a, *b), 0, 3);
    });
    fmt::print("{{\n");
    print("csgUnionCopy", copy, balls, false);
    print("combine", combined, balls, false);
    print("levelSetRebuild", rebuilt, balls, true);
    fmt::print("}}\n");
}
