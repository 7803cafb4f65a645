// Every operation on level sets stops soon after it is asked to, and frees what it held.
#include "modelling_fixture.h"

#include <mpuvdb/error.h>
#include <mpuvdb/shape.h>

#include <fmt/format.h>

#include <condition_variable>
#include <cstdlib>
#include <malloc.h>
#include <thread>

namespace mpuvdb::test
{
namespace
{

using Clock = std::chrono::steady_clock;
using Seconds = std::chrono::duration<double>;
using Work = std::function<void(Interrupter&)>;

/// The promise is 0.25 s; a machine that runs other tests beside this one takes longer.
constexpr Seconds kLatest{2};

/// Asks for a stop at a moment, from a thread of its own.
class Stopper
{
public:
    Stopper(Interrupter& progress, Seconds after)
        : mThread([this, &progress, after] {
              std::unique_lock<std::mutex> lock(mMutex);
              if (mDone.wait_for(lock, after, [this] { return mEnded; })) return;
              mAsked = Clock::now();
              mWasAsked = true;
              progress.stop();
          })
    {
    }
    /// @return how long ago the stop was asked for; negative if it was not.
    Seconds end()
    {
        const Clock::time_point now = Clock::now();
        {
            const std::lock_guard<std::mutex> lock(mMutex);
            mEnded = true;
        }
        mDone.notify_all();
        mThread.join();
        return mWasAsked ? now - mAsked : Seconds(-1);
    }

private:
    std::mutex mMutex;
    std::condition_variable mDone;
    bool mEnded = false, mWasAsked = false;
    Clock::time_point mAsked;
    std::thread mThread; ///< last: it uses the others
};

/// A tree that nobody frees has a node larger than this; threads keep buffers of their own.
constexpr long kKept = 100000; // bytes

/// Of the heap.
std::size_t bytesInUse()
{
    const struct mallinfo2 heap = mallinfo2();
    return heap.uordblks + heap.hblkhd;
}

/// Stop @a work after each of some parts of its duration. @return the longest it took to end.
Seconds latency(const Work& work)
{
    Interrupter whole;
    const Clock::time_point start = Clock::now();
    work(whole);
    const Seconds duration = Clock::now() - start;

    const std::size_t before = bytesInUse();
    Seconds longest{0};
    for (const double part : {0.1, 0.4, 0.8}) {
        Interrupter progress;
        Stopper stopper(progress, part * duration);
        bool stopped = false;
        try {
            work(progress);
        } catch (const Interrupted&) {
            stopped = true;
        }
        const Seconds took = stopper.end();
        EXPECT_TRUE(stopped || took < kLatest) << "done in spite of the stop";
        longest = std::max(longest, took);
    }
    EXPECT_LT(long(bytesInUse()) - long(before), kKept) << "memory that a stop did not free";
    return longest;
}

/// Radius in voxels of what is worked on; the promise is meant for larger grids than tests can
/// afford.
double radius()
{
    const char* const told = std::getenv("MPUVDB_STOP_RADIUS");
    return told ? std::atof(told) : 40;
}

class StopTest : public testing::TestWithParam<std::pair<const char*, std::function<Work()>>>
{
};

TEST_P(StopTest, ComesInTime)
{
    const Seconds longest = latency(GetParam().second());
    RecordProperty("milliseconds", int(1000 * longest.count()));
    std::printf("%s: %.0f ms\n", GetParam().first, 1000 * longest.count());
    EXPECT_LT(longest.count(), kLatest.count());
}

std::string nameOf(const testing::TestParamInfo<StopTest::ParamType>& test)
{
    return test.param.first;
}

LevelSet solidOf(const std::string& description, double halfWidth = 3)
{
    return sampled(*makeSolidField(parseSolid(description)), 1 / radius(), halfWidth);
}

LevelSet ball()
{
    return solidOf("sphere(1)");
}

LevelSet part()
{
    return solidOf("translate(roundedbox(1.4,1.2,1.6,0.2),0.5,0.1,0)");
}

Shape shapeOf(const std::string& description)
{
    return Shape(makeSolidField(parseSolid(description)), description);
}

Work evaluation(const Shape& shape)
{
    ShapeSettings settings;
    settings.voxelSize = 1 / radius();
    return [=](Interrupter& progress) { shape.evaluate(settings, &progress); };
}

Work smoothing(Filter filter)
{
    SmoothSettings settings;
    settings.filter = filter;
    settings.width = 2;
    settings.iterations = 2;
    return [=, a = ball()](Interrupter& progress) { smooth(a, settings, &progress); };
}

Work combining(Boolean kind, double blend)
{
    return [=, a = ball(), b = part()](Interrupter& progress) {
        combine(kind, {a, b}, blend, &progress);
    };
}

Work morphing(Morphing how)
{
    return [=, a = ball(), b = part()](Interrupter& progress) { morph(a, b, 0.4, how, &progress); };
}

INSTANTIATE_TEST_SUITE_P(
    Operations, StopTest,
    testing::Values(
        std::pair{"combine", [] { return combining(Boolean::Union, 0); }},
        std::pair{"blend", [] { return combining(Boolean::Difference, 0.08); }},
        std::pair{"oneLattice",
                  []() -> Work {
                      return [a = ball(), b = sampled(*makeSolidField(parseSolid("sphere(1)")),
                                                      1.3 / radius())](Interrupter& progress) {
                          onOneLattice({a, b}, 0, &progress);
                      };
                  }},
        std::pair{"resample",
                  []() -> Work {
                      return [a = ball()](Interrupter& progress) {
                          resample(a, {Vec3d::Zero(), 0.8 / radius()}, 3, &progress);
                      };
                  }},
        std::pair{"withHalfWidth",
                  []() -> Work {
                      return
                          [a = ball()](Interrupter& progress) { withHalfWidth(a, 12, &progress); };
                  }},
        std::pair{"redistance",
                  []() -> Work {
                      return [a = ball()](Interrupter& progress) {
                          redistance(a.grid(), 5, &progress);
                      };
                  }},
        std::pair{"voxelize",
                  []() -> Work {
                      const Mesh mesh = extractMesh(ball());
                      SampleSettings settings;
                      settings.lattice = {Vec3d::Zero(), 1 / radius()};
                      return [=](Interrupter& progress) { voxelize(mesh, settings, &progress); };
                  }},
        std::pair{"repair",
                  []() -> Work {
                      Mesh mesh = extractMesh(ball());
                      mesh.triangles.resize(mesh.triangles.size() / 4 * 3);
                      SampleSettings settings;
                      settings.lattice = {Vec3d::Zero(), 1 / radius()};
                      return [=](Interrupter& progress) {
                          voxelize(mesh, settings, RepairSettings{}, &progress);
                      };
                  }},
        std::pair{"offset",
                  []() -> Work {
                      return [a = ball()](Interrupter& progress) { offset(a, 0.15, &progress); };
                  }},
        std::pair{"shell",
                  []() -> Work {
                      return [a = ball()](Interrupter& progress) {
                          shell(a, 0.15, Wall::Inward, &progress);
                      };
                  }},
        std::pair{"mean", [] { return smoothing(Filter::Mean); }},
        std::pair{"gaussian", [] { return smoothing(Filter::Gaussian); }},
        std::pair{"median", [] { return smoothing(Filter::Median); }},
        std::pair{"curvature", [] { return smoothing(Filter::MeanCurvature); }},
        std::pair{"linear", [] { return morphing(Morphing::Linear); }},
        std::pair{"advection", [] { return morphing(Morphing::Advection); }},
        std::pair{"fog",
                  []() -> Work {
                      return [a = solidOf("sphere(1)", 8)](Interrupter& p) { toFog(a, &p); };
                  }},
        std::pair{"components",
                  []() -> Work {
                      return [a = ball()](Interrupter& progress) { components(a, &progress); };
                  }},
        std::pair{"keepComponents",
                  []() -> Work {
                      return [a = ball()](Interrupter& progress) {
                          keepComponents(a, 0, 1, &progress);
                      };
                  }},
        std::pair{"keepOneOfTwo",
                  []() -> Work {
                      // So near to each other that one has to be made anew without the other.
                      const LevelSet both = solidOf(fmt::format(
                          "union(sphere(1),translate(sphere(0.5),{},0,0))", 1.5 + 3 / radius()));
                      return [=](Interrupter& progress) { keepComponents(both, 0, 1, &progress); };
                  }},
        std::pair{"measure",
                  []() -> Work {
                      return [a = ball()](Interrupter& progress) { measure(a, &progress); };
                  }}),
    nameOf);

INSTANTIATE_TEST_SUITE_P(
    Shapes, StopTest,
    testing::Values(std::pair{"twist",
                              [] {
                                  const auto twist = makeTwist({}, 1);
                                  return evaluation(shapeOf("box(1,1,1)").warped(twist, "twist"));
                              }},
                    std::pair{"warpOfBlend",
                              [] {
                                  const Shape both = Shape::combine(
                                      Boolean::Union,
                                      {shapeOf("sphere(0.8)"), shapeOf("box(1.3,1.3,1.3)")}, 0.05);
                                  return evaluation(both.warped(makeTwist({}, 0.5), "twist"));
                              }},
                    std::pair{"program",
                              [] {
                                  return evaluation(
                                      (shapeOf("sphere(1)") - shapeOf("torus(0.9,0.2)"))
                                          .offset(-0.05)
                                          .shell(0.1, Wall::Centered));
                              }}),
    nameOf);

} // namespace
} // namespace mpuvdb::test
