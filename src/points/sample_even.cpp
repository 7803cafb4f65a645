#include "surface_sampling.h"

#include <mpuvdb/error.h>
#include <mpuvdb/progress.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace mpuvdb
{
namespace
{

/// The darts that stuck, in cells as wide as the darts' radius, behind a hash table.
class DartBoard
{
public:
    DartBoard(const std::vector<SurfacePoint>& darts, double radius, std::size_t expected)
        : mDarts(darts), mRadius(radius)
    {
        std::size_t buckets = 64;
        while (buckets < 2 * expected) buckets *= 2;
        mHeads.assign(buckets, kNone);
        mStuck.reserve(expected);
    }

    /// Whether dart @a d, which sticks then, has no neighbour on its side of the surface.
    bool stick(std::uint32_t d)
    {
        const Vec3i cell = cellOf(mDarts[d].position);
        // The own cell first: it holds most of the neighbours that a dart may have.
        if (meets(cell, d)) return false;
        for (int k = 0; k < 27; ++k) {
            if (k == 13) continue;
            if (meets(cell + Vec3i(k / 9 - 1, k / 3 % 3 - 1, k % 3 - 1), d)) return false;
        }
        std::uint32_t& head = mHeads[bucketOf(cell)];
        mStuck.push_back({d, head});
        head = std::uint32_t(mStuck.size() - 1);
        return true;
    }

    std::size_t size() const { return mStuck.size(); }
    std::uint32_t dart(std::size_t i) const { return mStuck[i].dart; }

private:
    static constexpr std::uint32_t kNone = ~0u;
    struct Stuck {
        std::uint32_t dart, next;
    };

    Vec3i cellOf(const Vec3d& p) const
    {
        const Vec3d c = (p - mDarts.front().position) / mRadius;
        return {int(std::floor(c.x())), int(std::floor(c.y())), int(std::floor(c.z()))};
    }
    std::size_t bucketOf(const Vec3i& c) const
    {
        const std::uint64_t h = std::uint64_t(c.x()) * 0x9e3779b97f4a7c15u ^
                                std::uint64_t(c.y()) * 0xc2b2ae3d27d4eb4fu ^
                                std::uint64_t(c.z()) * 0x165667b19e3779f9u;
        return (h ^ (h >> 29) ^ (h >> 43)) & (mHeads.size() - 1);
    }
    bool meets(const Vec3i& cell, std::uint32_t d) const
    {
        for (std::uint32_t s = mHeads[bucketOf(cell)]; s != kNone; s = mStuck[s].next)
            if (near(mDarts[mStuck[s].dart], mDarts[d])) return true;
        return false;
    }
    /// Near along the surface: the other side of a thin wall, or the next one, is another place.
    bool near(const SurfacePoint& a, const SurfacePoint& b) const
    {
        const Vec3d apart = b.position - a.position;
        const double squared = apart.squaredNorm();
        if (squared >= mRadius * mRadius) return false;
        constexpr float kOpposite = -0.5f, kUpright = 0.85f;
        if (a.normal.dot(b.normal) < kOpposite) return false;
        const Vec3f direction = apart.cast<float>();
        const float upright = kUpright * float(std::sqrt(squared));
        return std::abs(direction.dot(a.normal)) <= upright ||
               std::abs(direction.dot(b.normal)) <= upright;
    }

    const std::vector<SurfacePoint>& mDarts;
    double mRadius;
    std::vector<std::uint32_t> mHeads;
    std::vector<Stuck> mStuck;
};

DartBoard throwDarts(const std::vector<SurfacePoint>& darts, double radius, std::size_t expected,
                     Progress& progress)
{
    DartBoard board(darts, radius, expected);
    for (std::uint32_t d = 0; d < darts.size(); ++d) {
        if (d % 4096 == 0) progress.check();
        board.stick(d);
    }
    return board;
}

} // namespace

std::vector<SurfacePoint> sampleEven(const Solid& solid, std::uint64_t count, std::uint64_t seed,
                                     Progress& progress)
{
    constexpr std::uint64_t kDartsPerPoint = 8;
    if (count > std::numeric_limits<std::uint32_t>::max() / kDartsPerPoint)
        throw UsageError("sample: the even pattern makes at most 5e8 points. Ask for the random "
                         "pattern");
    const RandomSurface surface = sampleRandom(solid, count * kDartsPerPoint, seed, progress);
    // Search the largest radius at which enough darts stick; the surplus, at most a hundredth,
    // are the last that found a gap.
    constexpr int kMaxPasses = 12;
    double low = 0, high = HUGE_VAL;
    double radius = 0.83 * std::sqrt(surface.area / double(count));
    std::vector<SurfacePoint> best;
    for (int pass = 0; pass < kMaxPasses || best.empty(); ++pass) {
        const DartBoard board = throwDarts(surface.points, radius, count, progress);
        const std::size_t stuck = board.size();
        if (stuck >= count) {
            best.clear();
            for (std::size_t i = 0; i < count; ++i) best.push_back(surface.points[board.dart(i)]);
            if (stuck <= count + count / 100) break;
            low = radius;
        } else {
            high = radius;
        }
        // The number that sticks falls with the square of the radius.
        radius *= std::sqrt(double(stuck) / (1.004 * double(count)));
        if (!(radius > low && radius < high)) radius = high < HUGE_VAL ? (low + high) / 2 : 2 * low;
    }
    return best;
}

} // namespace mpuvdb
