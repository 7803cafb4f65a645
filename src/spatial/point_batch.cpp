#include "point_batch.h"

#include "compress.h"
#include "core/clones.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

namespace mpuvdb
{
namespace
{

using Floats = PointBatch::Floats;

MPUVDB_WIDE_CLONES
void squaredDistances(const PointArrays& points, const Vec3f& c, Floats& out)
{
    const std::size_t n = points.size();
    out.resize(n);
    const float *const x = points.x, *const y = points.y, *const z = points.z;
    float* const d2 = out.data();
    const float cx = c[0], cy = c[1], cz = c[2];
    for (std::size_t i = 0; i < n; ++i) {
        const float dx = x[i] - cx, dy = y[i] - cy, dz = z[i] - cz;
        d2[i] = dx * dx + dy * dy + dz * dz;
    }
}

using Marks = UnsetVector<std::uint32_t>;

/// Mark with 1 the values below a limit, others with 0.
MPUVDB_WIDE_CLONES
void markBelow(const Floats& values, float limit, Marks& out)
{
    const std::size_t n = values.size();
    out.resize(n);
    const float* const v = values.data();
    std::uint32_t* const mark = out.data();
    for (std::size_t i = 0; i < n; ++i) mark[i] = v[i] < limit ? 1u : 0u;
}

/// Mark with 1 the points from @a begin to before @a end that are within a ball, others with 0.
MPUVDB_WIDE_CLONES
void markBall(const PointArrays& points, std::size_t begin, std::size_t end, const Vec3f& c,
              float radius2, Marks& out)
{
    out.resize(end - begin);
    const float *const x = points.x + begin, *const y = points.y + begin,
                       *const z = points.z + begin;
    std::uint32_t* const mark = out.data();
    const float cx = c[0], cy = c[1], cz = c[2];
    for (std::size_t i = 0; i < end - begin; ++i) {
        const float dx = x[i] - cx, dy = y[i] - cy, dz = z[i] - cz;
        mark[i] = dx * dx + dy * dy + dz * dz < radius2 ? 1u : 0u;
    }
}

/// Set bit o of mask[i] if point i is in the ball of octant o.
MPUVDB_WIDE_CLONES
void octantMasks(const PointArrays& points, const Vec3f& low, const Vec3f& high, float radius2,
                 Marks& out)
{
    const std::size_t n = points.size();
    out.resize(n);
    const float *const x = points.x, *const y = points.y, *const z = points.z;
    std::uint32_t* const mask = out.data();
    const float lx = low[0], ly = low[1], lz = low[2], hx = high[0], hy = high[1], hz = high[2];
    for (std::size_t i = 0; i < n; ++i) {
        const float xl = (x[i] - lx) * (x[i] - lx), xh = (x[i] - hx) * (x[i] - hx);
        const float yl = (y[i] - ly) * (y[i] - ly), yh = (y[i] - hy) * (y[i] - hy);
        const float zl = (z[i] - lz) * (z[i] - lz), zh = (z[i] - hz) * (z[i] - hz);
        const float ll = xl + yl, hl = xh + yl, lh = xl + yh, hh = xh + yh;
        mask[i] = (ll + zl < radius2 ? 1u : 0u) | (hl + zl < radius2 ? 2u : 0u) |
                  (lh + zl < radius2 ? 4u : 0u) | (hh + zl < radius2 ? 8u : 0u) |
                  (ll + zh < radius2 ? 16u : 0u) | (hl + zh < radius2 ? 32u : 0u) |
                  (lh + zh < radius2 ? 64u : 0u) | (hh + zh < radius2 ? 128u : 0u);
    }
}

MPUVDB_WIDE_CLONES
void findLeastAndMost(const Floats& values, float& least, float& most)
{
    constexpr std::size_t kLanes = 8; ///< lanes of a vector [derived: floats of 256 bits]
    using Lanes = float __attribute__((vector_size(4 * kLanes)));
    const std::size_t n = values.size(), whole = n / kLanes * kLanes;
    Lanes low = Lanes{} + values[0], high = low;
    for (std::size_t i = 0; i < whole; i += kLanes) {
        Lanes v;
        std::memcpy(&v, &values[i], sizeof v);
        low = v < low ? v : low;
        high = v > high ? v : high;
    }
    least = most = values[0];
    for (std::size_t k = 0; k < kLanes; ++k) {
        least = std::min(least, low[k]);
        most = std::max(most, high[k]);
    }
    for (std::size_t i = whole; i < n; ++i) {
        least = std::min(least, values[i]);
        most = std::max(most, values[i]);
    }
}

MPUVDB_WIDE_CLONES
std::size_t countBelow(const Floats& values, float limit)
{
    std::uint32_t count = 0;
    for (const float v : values) count += v < limit;
    return count;
}

float justAbove(float value)
{
    return std::nextafter(value, std::numeric_limits<float>::infinity());
}

/// Number of values up to a limit.
struct Least {
    float limit;
    std::size_t count;
};

/// A limit with at least @a k of the values (all, if there are fewer), and at most half as many
/// more unless values are equal. Counting has no branches; squared distances on a surface are about
/// uniform, so that linear interpolation between two counts converges fast.
Least leastOf(const Floats& values, std::size_t k)
{
    float low = 0;
    Least least{0, values.size()};
    findLeastAndMost(values, low, least.limit);
    std::size_t below = 0; // counted at low
    for (int step = 0; step < 16 && 2 * least.count > 3 * k; ++step) {
        const float share = (1.25f * float(k) - float(below)) / float(least.count - below);
        const float middle = low + (least.limit - low) * (step % 3 == 2 ? 0.5f : share);
        const std::size_t count = countBelow(values, justAbove(middle));
        if (count < k)
            low = middle, below = count;
        else
            least = {middle, count};
    }
    return least;
}

} // namespace

/// Select the indices of distances below a limit, without branches.
void BatchFilter::select(float below)
{
    const std::size_t n = mDistance2.size();
    mIndices.resize(n + 1);
    mSelected = 0;
    for (std::size_t i = 0; i < n; ++i) {
        mIndices[mSelected] = std::uint32_t(i);
        mSelected += mDistance2[i] < below;
    }
}

/// Append the selected points.
void BatchFilter::append(const PointArrays& from, PointBatch& out) const
{
    const std::size_t before = out.size();
    out.resize(before + mSelected);
    const auto two = [&](const float* a, Floats& toA, const float* b, Floats& toB) {
        for (std::size_t i = 0; i < mSelected; ++i) {
            const std::uint32_t n = mIndices[i];
            toA[before + i] = a[n];
            toB[before + i] = b[n];
        }
    };
    two(from.x, out.x, from.y, out.y), two(from.z, out.z, from.nx, out.nx);
    two(from.ny, out.ny, from.nz, out.nz);
    for (std::size_t i = 0; i < mSelected; ++i)
        out.confidence[before + i] = from.confidence[mIndices[i]];
}

/// Append those points from @a begin on, one per mark, whose mark has one of @a bits.
void BatchFilter::appendMarked(const PointArrays& from, std::size_t begin, std::uint32_t bits,
                               PointBatch& out) const
{
    const std::size_t before = out.size(), n = mMask.size();
    if (n == 0) return;
    out.resize(before + n + kCompressSlack);
    const std::array<const float*, kPointFloats> sources = {
        &from.x[begin],  &from.y[begin],  &from.z[begin],         &from.nx[begin],
        &from.ny[begin], &from.nz[begin], &from.confidence[begin]};
    const std::array<float*, kPointFloats> targets = {
        &out.x[before],  &out.y[before],  &out.z[before],         &out.nx[before],
        &out.ny[before], &out.nz[before], &out.confidence[before]};
    out.resize(before + compress(sources, mMask.data(), n, bits, targets));
}

void BatchFilter::ball(const PointArrays& from, const Vec3d& center, double radius, PointBatch& out)
{
    out.clear();
    appendBall(from, 0, from.size(), 1, center, radius, out);
}

int BatchFilter::grownBall(const PointArrays& from, const Vec3d& center, double radius,
                           double growth, int most, std::size_t wanted, PointBatch& out)
{
    const auto limit = [&](int steps) {
        const double grown = radius * (1 + growth * steps);
        return float(grown * grown);
    };
    squaredDistances(from, center.cast<float>(), mDistance2);
    const auto isEnough = [&](int steps) { return countBelow(mDistance2, limit(steps)) >= wanted; };
    if (most < 1 || !isEnough(most)) return 0;
    int enough = most;
    for (int tooFew = 0; enough - tooFew > 1;) {
        const int steps = (tooFew + enough) / 2;
        (isEnough(steps) ? enough : tooFew) = steps;
    }
    markBelow(mDistance2, limit(enough), mMask);
    out.clear();
    appendMarked(from, 0, 1, out);
    return enough;
}

void BatchFilter::octants(const PointArrays& from, const Vec3d& center, double half, double radius,
                          std::array<PointBatch, 8>& out)
{
    const Vec3d offset = Vec3d::Constant(half);
    octantMasks(from, (center - offset).cast<float>(), (center + offset).cast<float>(),
                float(radius * radius), mMask);
    for (std::size_t octant = 0; octant < 8; ++octant) {
        out[octant].clear();
        appendMarked(from, 0, 1u << octant, out[octant]);
    }
}

double BatchFilter::nearest(const PointArrays& from, const Vec3d& center, std::size_t count,
                            PointBatch& out)
{
    squaredDistances(from, center.cast<float>(), mDistance2);
    const float limit = leastOf(mDistance2, count).limit;
    markBelow(mDistance2, justAbove(limit), mMask);
    out.clear();
    appendMarked(from, 0, 1, out);
    return std::sqrt(double(limit));
}

std::size_t BatchFilter::nearestOf(const PointArrays& from, const Vec3d& center)
{
    squaredDistances(from, center.cast<float>(), mDistance2);
    return std::size_t(std::min_element(mDistance2.begin(), mDistance2.end()) - mDistance2.begin());
}

void BatchFilter::strided(const PointArrays& from, std::size_t stride, PointBatch& out)
{
    mSelected = (from.size() + stride - 1) / stride;
    mIndices.resize(mSelected);
    for (std::size_t i = 0; i < mSelected; ++i) mIndices[i] = std::uint32_t(i * stride);
    out.clear();
    append(from, out);
}

void BatchFilter::appendBall(const PointArrays& from, std::size_t begin, std::size_t end,
                             std::size_t stride, const Vec3d& center, double radius,
                             PointBatch& out)
{
    if (begin >= end) return;
    const Vec3f c = center.cast<float>();
    const auto below = float(radius * radius);
    if (stride == 1) {
        // Points at once: there is only ever room for so many more than are in the ball. [free:
        // the same points]
        constexpr std::size_t kAtOnce = 4096;
        for (std::size_t n = begin; n < end; n += kAtOnce) {
            markBall(from, n, std::min(n + kAtOnce, end), c, below, mMask);
            appendMarked(from, n, 1, out);
        }
        return;
    }
    mIndices.resize((end - begin) / stride + 2);
    mSelected = 0;
    for (std::size_t n = begin; n < end; n += stride) {
        const float dx = from.x[n] - c[0], dy = from.y[n] - c[1], dz = from.z[n] - c[2];
        mIndices[mSelected] = std::uint32_t(n);
        mSelected += dx * dx + dy * dy + dz * dz < below;
    }
    append(from, out);
}

double BatchFilter::spacing(const PointArrays& ball, const Vec3d& center, double radius)
{
    constexpr std::size_t kProbes = 3; ///< points whose spacing is measured [tuned: unseen_bench]
    const std::size_t n = ball.size();
    if (n <= kSpacingNeighbors) return 0;
    squaredDistances(ball, center.cast<float>(), mDistance2);
    select(float(radius * radius / 4));
    if (mSelected == 0) mIndices[mSelected++] = std::uint32_t(n / 2);
    std::array<std::uint32_t, kProbes> probes;
    for (std::size_t k = 0; k < kProbes; ++k)
        probes[k] = mIndices[(2 * k + 1) * mSelected / (2 * kProbes)];
    std::array<double, kProbes> found;
    for (std::size_t k = 0; k < kProbes; ++k) {
        const std::uint32_t p = probes[k];
        squaredDistances(ball, Vec3f(ball.x[p], ball.y[p], ball.z[p]), mDistance2);
        const Least near = leastOf(mDistance2, kSpacingNeighbors + 1);
        // A disc has the area of as many cells as it holds points, without the probe.
        found[k] = std::sqrt(M_PI / double(near.count - 1) * double(near.limit));
    }
    std::sort(found.begin(), found.end());
    return found[kProbes / 2];
}

} // namespace mpuvdb
