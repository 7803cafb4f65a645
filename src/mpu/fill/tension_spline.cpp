#include "tension_spline.h"

#include "core/clones.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cstdlib>
#include <tbb/parallel_for.h>
#include <utility>

namespace mpuvdb
{

/// A row of nodes of a level, from its first interior node on.
struct SplineRow {
    float* u[3];
    const float* b[3];
    const float* weight;
    std::ptrdiff_t di, dj; ///< to the next plane and row
    float scale;           ///< of second differences: 1 / step^2
};

namespace
{

/// Square of the tension. [derived: of it]
constexpr float kTension2 = TensionSpline::kTension * TensionSpline::kTension;
/// Weights of the squares of Laplacian and gradient. [derived: by the tension]
constexpr float kBendShare = 2 * kTension2, kSlopeShare = kTension2 * kTension2;
/// Sweeps before and after a coarser level. [tuned: unseen_bench; with two, cycles do not converge
/// on parts]
constexpr int kSweeps = 3;
/// Sweeps on the coarsest level. [tuned: unseen_bench; 200 give the same]
constexpr int kCoarsestSweeps = 40;
/// Cycles on the levels but the finest. [tuned: unseen_bench; no other number was tried]
constexpr int kCoarseCycles = 3;

/// Most nodes of a grid that one thread loops over. [free: grain]
constexpr std::size_t kMinParallelNodes = 1 << 14;

/// Call f(i, j) for every interior row of the grid, in parallel; rows are independent.
template <typename F>
void forEachRow(const NodeGrid& grid, F f)
{
    const auto plane = [&](int i) {
        for (int j = 1; j < grid.n[1] - 1; ++j) f(i, j);
    };
    if (grid.size() > kMinParallelNodes)
        tbb::parallel_for(1, grid.n[0] - 1, plane);
    else
        for (int i = 1; i < grid.n[0] - 1; ++i) plane(i);
}

/// Index offsets of the next plane and the next row.
struct Strides {
    std::ptrdiff_t i, j;

    explicit Strides(const NodeGrid& grid) : i(std::ptrdiff_t(grid.n[1]) * grid.n[2]), j(grid.n[2])
    {
    }
};

/// Set sums[k], for 0 <= k < count, to the sum of the 27 nodes about @a from[2 k], weighted 1 to 8.
MPUVDB_WIDE_CLONES
void sumAround(const float* from, const Strides& fine, int count, float* sums)
{
    std::fill_n(sums, count, 0.0f);
    for (int di = -1; di <= 1; ++di)
        for (int dj = -1; dj <= 1; ++dj) {
            const float* const row = from + di * fine.i + dj * fine.j;
            const auto side = float((2 - std::abs(di)) * (2 - std::abs(dj))), middle = 2 * side;
            for (int k = 0; k < count; ++k) {
                float sum = sums[k];
                sum += side * row[2 * k - 1];
                sum += middle * row[2 * k];
                sum += side * row[2 * k + 1];
                sums[k] = sum;
            }
        }
}

/// Means of 27 fine interior nodes at the coarse interior nodes.
void restrictTo(const NodeGrid& fine, const std::vector<float>& from, const NodeGrid& coarse,
                std::vector<float>& to)
{
    to.resize(coarse.size());
    const Strides strides(fine);
    const int count = coarse.n[2] - 2;
    forEachRow(coarse, [&](int i, int j) {
        float* const row = &to[coarse.index(i, j, 1)];
        sumAround(&from[fine.index(2 * i, 2 * j, 2)], strides, count, row);
        for (int k = 0; k < count; ++k) row[k] *= 1.0f / 64.0f;
    });
}

/// Trilinear interpolation between four rows of @a count + 1 coarse nodes, added to or assigned to
/// the two fine nodes from each on.
MPUVDB_WIDE_CLONES
void interpolateRows(const float* const (&rows)[4], int count, bool add, float* to)
{
    const float *const r0 = rows[0], *const r1 = rows[1], *const r2 = rows[2], *const r3 = rows[3];
    if (!add) std::fill_n(to, 2 * count, 0.0f);
    for (int k = 0; k < count; ++k) {
        const float at = (r0[k] + r0[k]) + (r1[k] + r1[k]) + (r2[k] + r2[k]) + (r3[k] + r3[k]);
        const float between =
            (r0[k] + r0[k + 1]) + (r1[k] + r1[k + 1]) + (r2[k] + r2[k + 1]) + (r3[k] + r3[k + 1]);
        to[2 * k] += at * 0.125f;
        to[2 * k + 1] += between * 0.125f;
    }
}

/// Trilinear interpolation of the coarse values at fine interior nodes, added or assigned.
void prolong(const NodeGrid& coarse, const std::vector<float>& from, const NodeGrid& fine,
             std::vector<float>& to, bool add)
{
    forEachRow(fine, [&](int i, int j) {
        const int i0 = i / 2, i1 = (i + 1) / 2, j0 = j / 2, j1 = (j + 1) / 2;
        const float* const rows[4] = {
            &from[coarse.index(i0, j0, 0)], &from[coarse.index(i0, j1, 0)],
            &from[coarse.index(i1, j0, 0)], &from[coarse.index(i1, j1, 0)]};
        float* const row = &to[fine.index(i, j, 0)];
        const float border = row[0];
        interpolateRows(rows, coarse.n[2] - 1, add, row);
        row[0] = border;
    });
}

/// Relax the three unknowns of every other node of a row together, from @a first on. All are
/// computed, which is faster than to skip half of them.
MPUVDB_WIDE_CLONES
void relaxRow(const SplineRow& row, int count, int first)
{
    constexpr int kStrip = 64; ///< nodes at once, even [free: a buffer's size]
    const std::ptrdiff_t di = row.di, dj = row.dj;
    const float scale = row.scale, diagonal = 6 * scale, bend = diagonal + kBendShare;
    const float pivot = (bend * diagonal + kSlopeShare) * diagonal;
    float next[3][kStrip];
    for (int begin = 0; begin < count; begin += kStrip) {
        const int part = std::min(kStrip, count - begin);
        for (std::size_t c = 0; c < 3; ++c) {
            const float* const u = row.u[c] + begin;
            for (int k = 0; k < part; ++k)
                next[c][k] = scale * ((u[k - di] + u[k + di]) + (u[k - dj] + u[k + dj]) +
                                      (u[k - 1] + u[k + 1]));
        }
        const float *const b0 = row.b[0] + begin, *const b1 = row.b[1] + begin,
                           *const b2 = row.b[2] + begin, *const weight = row.weight + begin;
        for (int k = 0; k < part; ++k) {
            // Lap u = -p - diagonal u, Lap Lap u = diagonal (p + diagonal u) - q.
            const float p = b0[k] - next[0][k], q = b1[k] - next[1][k], r = b2[k] + next[2][k];
            const float u = (r - bend * (diagonal * p - q) - kSlopeShare * p) / (pivot + weight[k]);
            const float turn = p + diagonal * u;
            next[0][k] = u;
            next[1][k] = -turn;
            next[2][k] = diagonal * turn - q;
        }
        for (std::size_t c = 0; c < 3; ++c) {
            float* const u = row.u[c] + begin;
            for (int k = 0; k < part; ++k) u[k] = ((k ^ first) & 1) ? u[k] : next[c][k];
        }
    }
}

/// Set the residual of an equation at the nodes of a row.
MPUVDB_WIDE_CLONES
void residualRow(const SplineRow& row, std::size_t equation, int count, float* residual)
{
    const std::ptrdiff_t di = row.di, dj = row.dj;
    const float* const u = row.u[equation];
    const float* const b = row.b[equation];
    const float scale = row.scale;
    for (int k = 0; k < count; ++k) {
        const float sum = (u[k - di] + u[k + di]) + (u[k - dj] + u[k + dj]) + (u[k - 1] + u[k + 1]);
        residual[k] = scale * (sum - 6 * u[k]);
    }
    if (equation < 2) {
        const float* const next = row.u[equation + 1];
        for (int k = 0; k < count; ++k) residual[k] = b[k] - (residual[k] - next[k]);
        return;
    }
    const float *const value = row.u[0], *const bend = row.u[1], *const weight = row.weight;
    for (int k = 0; k < count; ++k)
        residual[k] =
            b[k] + residual[k] - kBendShare * u[k] + kSlopeShare * bend[k] - weight[k] * value[k];
}

} // namespace

TensionSpline::TensionSpline(const NodeGrid& grid, std::vector<float> weight, Interrupter& progress)
    : mNone(std::size_t(grid.n[2]), 0.0f), mResidual(grid.size()), mProgress(progress)
{
    mLevels.push_back({grid, 1, std::move(weight), {}, {}});
    for (;;) {
        const Level& fine = mLevels.back();
        NodeGrid coarse = fine.grid;
        for (int& n : coarse.n) n = n / 2 + 1;
        if (*std::min_element(coarse.n.begin(), coarse.n.end()) < 3) break;
        if (!std::all_of(fine.grid.n.begin(), fine.grid.n.end(), [](int n) { return n % 2 == 1; }))
            break;
        Level level{coarse, 2 * fine.step, {}, {}, {}};
        restrictTo(fine.grid, fine.weight, coarse, level.weight);
        mLevels.push_back(std::move(level));
    }
}

/// The row (i, j) of a level.
SplineRow TensionSpline::rowOf(Level& level, int i, int j) const
{
    const std::size_t n = level.grid.index(i, j, 1);
    const Strides next(level.grid);
    SplineRow row;
    for (std::size_t c = 0; c < 3; ++c) {
        row.u[c] = &level.u[c][n];
        row.b[c] = level.b[c].empty() ? mNone.data() : &level.b[c][n];
    }
    row.weight = &level.weight[n];
    row.di = next.i;
    row.dj = next.j;
    row.scale = 1 / (level.step * level.step);
    return row;
}

void TensionSpline::relax(Level& level, int sweeps) const
{
    for (int pass = 0; pass < 2 * sweeps; ++pass)
        forEachRow(level.grid, [&](int i, int j) {
            relaxRow(rowOf(level, i, j), level.grid.n[2] - 2, (i + j + pass) & 1);
        });
}

void TensionSpline::restrictResidual(Level& fine, Level& coarse)
{
    for (std::size_t equation = 0; equation < 3; ++equation) {
        forEachRow(fine.grid, [&](int i, int j) {
            residualRow(rowOf(fine, i, j), equation, fine.grid.n[2] - 2,
                        &mResidual[fine.grid.index(i, j, 1)]);
        });
        restrictTo(fine.grid, mResidual, coarse.grid, coarse.b[equation]);
    }
}

void TensionSpline::cycle(std::size_t n)
{
    mProgress.check();
    Level& fine = mLevels[n];
    if (n + 1 == mLevels.size()) {
        relax(fine, kCoarsestSweeps);
        return;
    }
    relax(fine, kSweeps);
    Level& coarse = mLevels[n + 1];
    // What the full multigrid pass left there is not needed any more.
    restrictResidual(fine, coarse);
    for (std::vector<float>& u : coarse.u) u.assign(coarse.grid.size(), 0.0f);
    cycle(n + 1);
    for (std::size_t c = 0; c < 3; ++c)
        prolong(coarse.grid, coarse.u[c], fine.grid, fine.u[c], true);
    relax(fine, kSweeps);
}

void TensionSpline::fillBorder(std::size_t n, const std::vector<float>& border,
                               std::vector<float>& u) const
{
    const NodeGrid& grid = mLevels[n].grid;
    const int finest = 1 << n; // steps of the finest grid
    for (int i = 0; i < grid.n[0]; ++i)
        for (int j = 0; j < grid.n[1]; ++j)
            for (int k = 0; k < grid.n[2]; k += grid.borderStep(i, j))
                u[grid.index(i, j, k)] =
                    border[mLevels[0].grid.index(finest * i, finest * j, finest * k)];
}

std::vector<float> TensionSpline::solve(std::vector<float> data, const std::vector<float>& border,
                                        const std::vector<float>& bend, int cycles)
{
    for (std::size_t n = 0; n < data.size(); ++n) data[n] *= mLevels[0].weight[n];
    for (Level& level : mLevels)
        for (std::size_t c = 0; c < 3; ++c) {
            level.u[c].assign(level.grid.size(), 0.0f);
            level.b[c].clear();
        }
    mLevels[0].b[2] = std::move(data);
    for (std::size_t n = 1; n < mLevels.size(); ++n)
        restrictTo(mLevels[n - 1].grid, mLevels[n - 1].b[2], mLevels[n].grid, mLevels[n].b[2]);
    for (std::size_t n = mLevels.size(); n-- > 0;) {
        mProgress.check();
        Level& level = mLevels[n];
        fillBorder(n, border, level.u[0]);
        if (!bend.empty()) fillBorder(n, bend, level.u[1]);
        if (n + 1 == mLevels.size()) {
            relax(level, kCoarsestSweeps);
            continue;
        }
        for (std::size_t c = 0; c < 3; ++c)
            prolong(mLevels[n + 1].grid, mLevels[n + 1].u[c], level.grid, level.u[c], false);
        for (int c = 0; c < (n == 0 ? cycles : kCoarseCycles); ++c) cycle(n);
    }
    return std::exchange(mLevels[0].u[0], {});
}

} // namespace mpuvdb
