// The union of two balls beside OpenVDB's, with and without its re-distancing, and fillets of two
// balls: time and exactness. csg_bench [radius in voxels]; JSON on standard output.
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

FloatGrid::Ptr ballAt(double radius, double x)
{
    return openvdb::tools::createLevelSetSphere<FloatGrid>(float(radius),
                                                           openvdb::Vec3f(float(x), 0, 0), 1, 3);
}

/// Two balls, blended by a rolling one.
struct Fillet {
    Balls balls;
    double rolling;

    /// The distance from @a p to the path of the rolling ball's center, and whether both balls
    /// touch it on the side of @a p, so that the fillet is what is near.
    bool isFilleted(const Vec3d& p, double& toPath) const
    {
        const double half = 0.5 * balls.apart, reach = balls.radius + rolling;
        const double x = p[0] - half, y = std::hypot(p[1], p[2]);
        const double path = std::sqrt(reach * reach - half * half);
        toPath = std::hypot(x, y - path);
        // Between the lines from the path to both centers.
        return (path - y) * half > std::abs(x) * path;
    }
};

FloatGrid::ConstPtr combined(const FloatGrid::Ptr& a, const FloatGrid::Ptr& b, double blend)
{
    mpuvdb::Interrupter progress;
    return mpuvdb::combine(mpuvdb::Boolean::Union, {mpuvdb::LevelSet(a), mpuvdb::LevelSet(b)},
                           blend, &progress)
        .gridPtr();
}

void print(const Fillet& fillet)
{
    const FloatGrid::Ptr a = ballAt(fillet.balls.radius, 0),
                         b = ballAt(fillet.balls.radius, fillet.balls.apart);
    Timing timing;
    for (int n = 0; n < 3; ++n) timing.run([&] { return combined(a, b, fillet.rolling); });
    const FloatGrid::ConstPtr sharp = combined(a, b, 0);
    double sum = 0, largest = 0, beyond = 0;
    std::uint64_t count = 0, changed = 0;
    for (auto it = timing.result->cbeginValueOn(); it; ++it) {
        double toPath = 0;
        if (fillet.isFilleted(it.getCoord().asVec3d(), toPath)) {
            const double error = std::abs(double(*it) - (fillet.rolling - toPath));
            sum += error;
            largest = std::max(largest, error);
            ++count;
        } else if (const double by = std::abs(*it - sharp->tree().getValue(it.getCoord()));
                   by > 0) {
            beyond = std::max(beyond, by);
            ++changed;
        }
    }
    fmt::print("  \"fillet of {:g} along balls of {:g}\": {{\"seconds\": {:.4f}, "
               "\"cpuSeconds\": {:.4f}, \"voxels\": {}, \"meanError\": {:.6f}, \"maxError\": "
               "{:.4f}, \"changedBeyond\": {}, \"by\": {:.6f}}},\n",
               fillet.rolling, fillet.balls.radius, bench::least(timing.wall),
               bench::least(timing.cpu), count, sum / double(count), largest, changed, beyond);
}

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
    const FloatGrid::Ptr a = ballAt(radius, 0), b = ballAt(radius, balls.apart);
    Timing copy, united, rebuilt;
    for (int n = 0; n < 3; ++n) {
        copy.run([&] { return openvdb::tools::csgUnionCopy(*a, *b); });
        united.run([&] { return combined(a, b, 0); });
    }
    rebuilt.run([&] {
        return openvdb::tools::levelSetRebuild(*openvdb::tools::csgUnionCopy(*a, *b), 0, 3);
    });
    fmt::print("{{\n");
    for (const Fillet& fillet :
         {Fillet{{100, 120}, 10}, Fillet{{100, 120}, 30}, Fillet{{17, 20}, 100}})
        print(fillet);
    print("csgUnionCopy", copy, balls, false);
    print("combine", united, balls, false);
    print("levelSetRebuild", rebuilt, balls, true);
    fmt::print("}}\n");
}
