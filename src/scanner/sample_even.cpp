#include "surface_sampling.h"

#include "core/morton.h"
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace mpuvdb
{
namespace
{

/// The darts that stuck, in cells as wide as the darts' radius. Cells lie in hashed blocks, so that
/// neighbors are near in memory.
class DartBoard
{
public:
    DartBoard(const std::vector<SurfacePoint>& darts, double radius, std::size_t expected)
        : mDarts(darts), mRadius(radius)
    {
        // A surface meets about a quarter of a block's cells.
        std::size_t blocks = 16;
        while (blocks * kBlockCells < 8 * expected) blocks *= 2;
        mBlocks = blocks;
        mHeads.assign(blocks * kBlockCells, kNone);
        mStuck.reserve(expected);
    }

    /// Whether a dart that stuck is near dart @a d, on the same side of the surface.
    bool isTaken(std::uint32_t d) const
    {
        const Vec3i cell = cellOf(mDarts[d].position);
        // The dart's own cell comes first: it holds most neighbors.
        if (meets(cell, d)) return true;
        for (int k = 0; k < 27; ++k) {
            if (k == 13) continue;
            if (meets(cell + Vec3i(k / 9 - 1, k / 3 % 3 - 1, k % 3 - 1), d)) return true;
        }
        return false;
    }
    void stick(std::uint32_t d)
    {
        std::uint32_t& head = mHeads[bucketOf(cellOf(mDarts[d].position))];
        mStuck.push_back({mDarts[d], d, head});
        head = std::uint32_t(mStuck.size() - 1);
    }

    std::size_t size() const { return mStuck.size(); }
    const SurfacePoint& dart(std::size_t i) const { return mStuck[i].point; }

private:
    static constexpr std::uint32_t kNone = ~0u; ///< no index [derived: the largest]
    static constexpr int kBlockBits = 2;        ///< of a cell's index per axis [free: time]
    static constexpr std::size_t kBlockCells = std::size_t(1) << 3 * kBlockBits; ///< [derived: all]
    struct Stuck {
        SurfacePoint point;
        std::uint32_t dart, next;
    };

    Vec3i cellOf(const Vec3d& p) const
    {
        const Vec3d c = (p - mDarts.front().position) / mRadius;
        return {int(std::floor(c.x())), int(std::floor(c.y())), int(std::floor(c.z()))};
    }
    std::size_t bucketOf(const Vec3i& c) const
    {
        const auto block = [&c](int axis) { return std::uint64_t(c[axis] >> kBlockBits); };
        const std::uint64_t h = block(0) * 0x9e3779b97f4a7c15u ^ block(1) * 0xc2b2ae3d27d4eb4fu ^
                                block(2) * 0x165667b19e3779f9u;
        const auto within = [&c](int axis) {
            return std::size_t(c[axis] & ((1 << kBlockBits) - 1)) << axis * kBlockBits;
        };
        return ((h ^ (h >> 29) ^ (h >> 43)) & (mBlocks - 1)) * kBlockCells +
               (within(0) | within(1) | within(2));
    }
    bool meets(const Vec3i& cell, std::uint32_t d) const
    {
        for (std::uint32_t s = mHeads[bucketOf(cell)]; s != kNone; s = mStuck[s].next)
            if (near(mStuck[s].point, mDarts[d])) return true;
        return false;
    }
    /// Whether two darts are near along the surface: places on the other side of a thin wall, or on
    /// the next wall, are not.
    bool near(const SurfacePoint& a, const SurfacePoint& b) const
    {
        const Vec3d apart = b.position - a.position;
        const double squared = apart.squaredNorm();
        if (squared >= mRadius * mRadius) return false;
        // The cosines from which normals are opposite, and a normal is along the connection.
        // [tuned: scan_sampler_test]
        constexpr float kOpposite = -0.5f, kUpright = 0.85f;
        if (a.normal.dot(b.normal) < kOpposite) return false;
        const Vec3f direction = apart.cast<float>();
        const float upright = kUpright * float(std::sqrt(squared));
        return std::abs(direction.dot(a.normal)) <= upright ||
               std::abs(direction.dot(b.normal)) <= upright;
    }

    const std::vector<SurfacePoint>& mDarts;
    double mRadius;
    std::size_t mBlocks;
    std::vector<std::uint32_t> mHeads;
    std::vector<Stuck> mStuck;
};

/// The end of a volley of darts, which is a quarter as large as all before it.
std::uint32_t volleyEnd(std::uint32_t begin, std::size_t darts)
{
    constexpr std::uint32_t kFirst = 1 << 14; // darts in the first volley [free: time]
    return std::uint32_t(std::min<std::size_t>(begin + std::max(kFirst, begin / 4), darts));
}

/// The darts' indices, those of each volley in spatial order.
std::vector<std::uint32_t> orderInSpace(const std::vector<SurfacePoint>& darts, double cell,
                                        Interrupter& progress)
{
    std::vector<std::uint64_t> keys(darts.size());
    std::vector<std::uint32_t> order(darts.size());
    tbb::parallel_for(
        tbb::blocked_range<std::size_t>(0, darts.size(), 1 << 14), [&](const auto& range) {
            progress.check();
            for (std::size_t d = range.begin(); d < range.end(); ++d) {
                const Vec3d at = (darts[d].position - darts[0].position) / cell;
                const auto number = [&at](int axis) {
                    constexpr double kMiddle = 1 << 20; // [derived: half of a key's 21 bits]
                    return std::uint64_t(std::clamp(at[axis] + kMiddle, 0.0, 2 * kMiddle - 1));
                };
                keys[d] = mortonKey(number(0), number(1), number(2));
                order[d] = std::uint32_t(d);
            }
        });
    for (std::uint32_t begin = 0; begin < darts.size();) {
        progress.check();
        const std::uint32_t end = volleyEnd(begin, darts.size());
        tbb::parallel_sort(order.begin() + begin, order.begin() + end,
                           [&](std::uint32_t a, std::uint32_t b) { return keys[a] < keys[b]; });
        begin = end;
    }
    return order;
}

/// Throws the darts one after the other: a dart sticks where no other is near. Those of a volley
/// that are near to earlier volleys' are left out first, on all threads.
DartBoard throwDarts(const std::vector<SurfacePoint>& darts,
                     const std::vector<std::uint32_t>& inSpace, double radius, std::size_t expected,
                     Interrupter& progress)
{
    DartBoard board(darts, radius, expected);
    std::vector<std::uint8_t> isFree;
    for (std::uint32_t begin = 0; begin < darts.size();) {
        const std::uint32_t end = volleyEnd(begin, darts.size());
        isFree.assign(end - begin, 0);
        tbb::parallel_for(tbb::blocked_range<std::uint32_t>(begin, end, 1 << 10),
                          [&](const auto& range) {
                              progress.check();
                              for (std::uint32_t n = range.begin(); n < range.end(); ++n)
                                  isFree[inSpace[n] - begin] = !board.isTaken(inSpace[n]);
                          });
        progress.check();
        for (std::uint32_t d = begin; d < end; ++d)
            if (isFree[d - begin] && !board.isTaken(d)) board.stick(d);
        begin = end;
    }
    return board;
}

} // namespace

std::vector<SurfacePoint> sampleEven(const Solid& solid, std::uint64_t count, std::uint64_t seed,
                                     Interrupter& progress)
{
    constexpr std::uint64_t kDartsPerPoint = 8; // [tuned: scan_sampler_test]
    if (count > std::numeric_limits<std::uint32_t>::max() / kDartsPerPoint)
        throw UsageError("sample: the even pattern makes at most 5e8 points. Ask for the random "
                         "pattern");
    const RandomSurface surface = sampleRandom(solid, count * kDartsPerPoint, seed, progress);
    // The largest radius is searched at which enough darts stick; the surplus, at most a hundredth,
    // are the last that found a gap.
    constexpr int kMaxPasses = 12; // [tuned: scan_sampler_test]
    double low = 0, high = HUGE_VAL;
    double radius = 0.83 * std::sqrt(surface.area / double(count));
    const std::vector<std::uint32_t> inSpace = orderInSpace(surface.points, 4 * radius, progress);
    std::vector<SurfacePoint> best;
    for (int pass = 0; pass < kMaxPasses || best.empty(); ++pass) {
        const DartBoard board = throwDarts(surface.points, inSpace, radius, count, progress);
        const std::size_t stuck = board.size();
        if (stuck >= count) {
            best.clear();
            for (std::size_t i = 0; i < count; ++i) best.push_back(board.dart(i));
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
