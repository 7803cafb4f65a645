// What planning bands saves: a scene of eight shapes, as a Shape and, operation by operation, with
// every grid as wide as the widest that is needed:
//     plan_bench [VOXEL_SIZE]
// Each way runs in a process of its own, whose largest resident set is reported.
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/scan_sampler.h>
#include <mpuvdb/shape.h>

#include <fmt/format.h>
#include <openvdb/tools/LevelSetMeasure.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <stdexcept>

using namespace mpuvdb;

namespace
{

/// Describes, and leaves the bands to the plan.
struct Planned {
    using Solid = Shape;

    Solid leaf(const char* description, const Vec3d& at = Vec3d::Zero()) const
    {
        return Shape(makeSolidField(parseSolid(description)), description)
            .moved(Eigen::Affine3d(Eigen::Translation3d(at)));
    }
    Solid combine(Boolean kind, std::vector<Solid> solids, double blend = 0) const
    {
        return Shape::combine(kind, std::move(solids), blend);
    }
    Solid offset(const Solid& solid, double by) const { return solid.offset(by); }
    Solid shell(const Solid& solid, double thickness) const
    {
        return solid.shell(thickness, Wall::Inward);
    }
    Solid twist(const Solid& solid, double angle) const
    {
        return solid.warped(makeTwist({}, angle), "twist");
    }
};

/// Makes each grid at once, as wide as the widest.
struct Widest {
    using Solid = LevelSet;
    ShapeSettings settings;
    Interrupter& progress;

    SampleSettings sampling() const
    {
        SampleSettings result;
        result.lattice = {Vec3d::Zero(), settings.voxelSize};
        result.halfWidth = settings.halfWidth;
        return result;
    }
    Solid leaf(const char* description, const Vec3d& at = Vec3d::Zero()) const
    {
        const FieldPtr field = makeMovedField(makeSolidField(parseSolid(description)),
                                              Eigen::Affine3d(Eigen::Translation3d(at)));
        return sampleField(*field, sampling(), &progress);
    }
    Solid combine(Boolean kind, const std::vector<Solid>& solids, double blend = 0) const
    {
        return mpuvdb::combine(kind, solids, blend, &progress);
    }
    Solid offset(const Solid& solid, double by) const
    {
        return mpuvdb::offset(solid, by, &progress);
    }
    Solid shell(const Solid& solid, double thickness) const
    {
        return mpuvdb::shell(solid, thickness, Wall::Inward, &progress);
    }
    Solid twist(const Solid& solid, double angle) const
    {
        return sampleField(*makeWarpedField(makeGridField(solid), makeTwist({}, angle)), sampling(),
                           &progress);
    }
};

/// A statue on a rounded base, bored, hollowed; a twisted horn; a wheel; a cut by a wall of which
/// most is far away, and by a hall that is farther still.
template <class Way>
typename Way::Solid scene(const Way& way)
{
    const auto body = way.combine(Boolean::Union,
                                  {way.leaf("sphere(0.7)", {0, 0, 1}),
                                   way.offset(way.leaf("box(1,1,0.4)", {0, 0, 0.2}), 0.15)},
                                  0.12);
    const auto bored =
        way.combine(Boolean::Difference, {way.shell(body, 0.1), way.leaf("cylinder(0.15,4)")});
    const auto horn = way.twist(way.combine(Boolean::Union,
                                            {way.leaf("capsule(0.1,1)", {0.15, 0, 2.1}),
                                             way.leaf("capsule(0.1,1)", {-0.15, 0, 2.1})},
                                            0.05),
                                4);
    const auto wheel = way.leaf("gear(16,0.6,0.3)", {1.2, 0, 0.5});
    return way.combine(Boolean::Difference,
                       {way.combine(Boolean::Union, {bored, horn, wheel}),
                        way.leaf("box(4,4,4)", {0, -2.5, 0}), way.leaf("sphere(3)", {9, 0, 0})});
}

struct Result {
    double peakBytes = 0, seconds = 0, volume = 0;
    std::uint64_t activeVoxels = 0;
};

/// Do @a work and write its result to @a pipe. @return exit status.
template <class Work>
int report(Work&& work, int pipe)
try {
    Interrupter progress;
    const LevelSet made = work(progress);
    Result result;
    result.activeVoxels = made.grid().activeVoxelCount();
    if (result.activeVoxels > 0) result.volume = openvdb::tools::levelSetVolume(made.grid());
    return write(pipe, &result, sizeof result) == ssize_t(sizeof result) ? 0 : 1;
} catch (const std::exception& error) {
    fmt::print(stderr, "plan_bench: {}\n", error.what());
    return 1;
}

/// What @a work takes in a process of its own.
template <class Work>
Result measured(Work&& work)
{
    int ends[2];
    if (pipe(ends) != 0) throw std::runtime_error("no pipe");
    const pid_t child = fork();
    if (child < 0) throw std::runtime_error("no process");
    if (child == 0) _exit(report(work, ends[1]));
    close(ends[1]);
    Result result;
    const bool told = read(ends[0], &result, sizeof result) == ssize_t(sizeof result);
    close(ends[0]);
    int status = 0;
    rusage usage{};
    wait4(child, &status, 0, &usage);
    if (!told || status != 0) throw std::runtime_error("the work in its own process failed");
    result.peakBytes = double(usage.ru_maxrss) * 1024;
    result.seconds = double(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
                     1e-6 * double(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
    return result;
}

void print(const char* name, const Result& result)
{
    fmt::print(
        "  \"{}\": {{\"peakMegabytes\": {:.1f}, \"cpuSeconds\": {:.2f}, \"activeVoxels\": {}, "
        "\"volume\": {:.6f}}},\n",
        name, result.peakBytes / 1e6, result.seconds, result.activeVoxels, result.volume);
}

} // namespace

int main(int argc, char** argv)
try {
    openvdb::initialize();
    ShapeSettings settings;
    settings.voxelSize = argc > 1 ? std::atof(argv[1]) : 0.01;
    const Shape shape = scene(Planned{});
    ShapeSettings widest = settings;
    for (const PlanStep& step : shape.plan(settings))
        widest.halfWidth = std::max(widest.halfWidth, step.halfWidth);

    const Result nothing = measured([&](Interrupter&) {
        return emptyLevelSet({Vec3d::Zero(), settings.voxelSize}, settings.halfWidth);
    });
    const Result planned =
        measured([&](Interrupter& progress) { return shape.evaluate(settings, &progress); });
    const Result wide = measured([&](Interrupter& progress) {
        return scene(Widest{widest, progress});
    });
    fmt::print("{{\n");
    print("nothing", nothing);
    print("planned", planned);
    print("widest", wide);
    fmt::print("  \"widestHalfWidth\": {:.1f},\n  \"memoryRatio\": {:.2f}\n}}\n", widest.halfWidth,
               (wide.peakBytes - nothing.peakBytes) / (planned.peakBytes - nothing.peakBytes));
} catch (const std::exception& error) {
    fmt::print(stderr, "plan_bench: {}\n", error.what());
    return 1;
}
