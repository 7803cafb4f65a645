#include "core/random.h"
#include "line_tracer.h"
#include "surface_sampling.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <tbb/parallel_for.h>

#include <algorithm>

namespace mpuvdb
{
namespace
{

/// The lines in a chunk. [tuned: time; it ends the estimate of the area]
constexpr std::uint64_t kChunkLines = 256;

/// Throws lines in numbered, independent chunks. Where the solid's parts are far apart, few lines
/// through the ball around all of them meet one: then lines go through balls around the parts, and
/// only crossings within their ball count.
class LineThrower
{
public:
    LineThrower(const Solid& solid, std::uint64_t seed)
        : mTracer(solid), mSeed(seed), mBalls(ballsAround(solid))
    {
        for (const Ball& ball : mBalls)
            mSquares.push_back(lastSquare() + ball.radius * ball.radius);
    }

    /// The sum of the areas of the balls' surfaces.
    double area() const { return 4 * M_PI * lastSquare(); }

    /// Appends the points of one chunk.
    void throwChunk(std::uint64_t chunk, std::vector<SurfacePoint>& points) const
    {
        std::vector<double> crossings;
        for (std::uint64_t i = 0; i < kChunkLines; ++i) {
            CounterRandom random(mSeed, RandomStream::Lines, chunk * kChunkLines + i);
            const Ball& ball = choose(random);
            const Vec3d direction = random.direction();
            const double radius = ball.radius * std::sqrt(random.uniform());
            const double angle = 2 * M_PI * random.uniform();
            const Eigen::Vector2d disc(radius * std::cos(angle), radius * std::sin(angle));
            const Vec3d origin = ball.middle + tangents(direction) * disc;
            mTracer.crossings(origin, direction, crossings);
            keepHalf(crossings, random);
            for (const double t : crossings) {
                const Vec3d p = origin + t * direction;
                if (mBalls.size() > 1 && !counts(p, ball, random)) continue;
                points.push_back({p, mTracer.solid().normal(p).cast<float>()});
            }
        }
    }

private:
    struct Ball {
        Vec3d middle;
        double radius;

        bool holds(const Vec3d& p) const { return (p - middle).norm() <= radius; }
    };

    static std::vector<Ball> ballsAround(const Solid& solid)
    {
        const auto ballAround = [](const Box3d& box) {
            return Ball{box.center(), box.diagonal().norm() / 2};
        };
        const Ball whole = ballAround(solid.bounds());
        std::vector<Ball> balls;
        double squares = 0;
        for (const Box3d& part : solid.parts()) {
            if (part.isEmpty()) continue;
            balls.push_back(ballAround(part));
            squares += balls.back().radius * balls.back().radius;
        }
        // The part of the lines through the whole ball below which parts' balls take fewer.
        // [tuned: time]
        constexpr double kMaxShare = 0.5;
        const bool apart = squares < kMaxShare * whole.radius * whole.radius;
        return apart && !balls.empty() ? balls : std::vector<Ball>{whole};
    }

    double lastSquare() const { return mSquares.empty() ? 0 : mSquares.back(); }

    /// A random ball, with a probability in proportion to its area.
    const Ball& choose(CounterRandom& random) const
    {
        if (mBalls.size() == 1) return mBalls.front();
        const double at = random.uniform() * lastSquare();
        const auto found = std::upper_bound(mSquares.begin(), mSquares.end() - 1, at);
        return mBalls[std::size_t(found - mSquares.begin())];
    }

    /// Whether a crossing counts: one in several balls is met by the lines of each, and counts
    /// once.
    bool counts(const Vec3d& p, const Ball& ball, CounterRandom& random) const
    {
        if (!ball.holds(p)) return false;
        const auto balls = std::count_if(mBalls.begin(), mBalls.end(),
                                         [&](const Ball& other) { return other.holds(p); });
        return balls == 1 || random.uniform() * double(balls) < 1;
    }

    /// Keeps a random half: a line that enters and leaves has an even number of crossings.
    static void keepHalf(std::vector<double>& crossings, CounterRandom& random)
    {
        const std::size_t half = crossings.size() / 2;
        for (std::size_t k = 0; k < half; ++k) {
            const auto other = k + std::size_t(random.uniform() * double(crossings.size() - k));
            std::swap(crossings[k], crossings[other]);
        }
        crossings.resize(half);
    }

    LineTracer mTracer;
    std::uint64_t mSeed;
    std::vector<Ball> mBalls;
    std::vector<double> mSquares; ///< cumulative sums of squared radii
};

} // namespace

RandomSurface sampleRandom(const Solid& solid, std::uint64_t count, std::uint64_t seed,
                           Interrupter& progress)
{
    // The chunks in the first and in the largest round. [tuned: time]
    constexpr std::uint64_t kFirstRound = 16, kMaxRound = 4096;
    // The chunks without a crossing after which there is no surface. [tuned: scan_sampler_test]
    constexpr std::uint64_t kMaxEmptyChunks = 16384;
    const LineThrower thrower(solid, seed);
    RandomSurface result;
    result.points.reserve(count);
    std::uint64_t chunks = 0, found = 0, round = kFirstRound;
    while (found < count) {
        std::vector<std::vector<SurfacePoint>> pieces(round);
        tbb::parallel_for(std::uint64_t(0), round, [&](std::uint64_t i) {
            progress.check();
            thrower.throwChunk(chunks + i, pieces[i]);
        });
        chunks += round;
        for (const auto& piece : pieces) {
            found += piece.size();
            const std::size_t room = count - result.points.size();
            result.points.insert(result.points.end(), piece.begin(),
                                 piece.begin() + std::min(piece.size(), room));
        }
        if (found == 0 && chunks >= kMaxEmptyChunks)
            throw InputError(
                "sample: the solid has no surface that the scanner finds: it is empty, "
                "or its walls are thinner than 1e-5 of its size. Give another solid");
        const double yield = std::max(double(found), 1.0) / double(chunks);
        const double missing = double(count - std::min(count, found)) / yield;
        round = std::clamp(std::uint64_t(1.01 * missing) + 1, kFirstRound, kMaxRound);
    }
    // Each crossing is kept with probability 1/2; lines meet twice the share of the balls' area.
    const double lines = double(std::max<std::uint64_t>(chunks * kChunkLines, 1));
    result.area = thrower.area() * double(found) / lines;
    return result;
}

} // namespace mpuvdb
