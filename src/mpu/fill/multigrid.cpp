#include "multigrid.h"

#include "core/clones.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cstdlib>
#include <tbb/parallel_for.h>
#include <utility>

namespace mpuvdb
{
namespace
{

constexpr float kOverRelaxation = 1.15f; ///< factor of a step [tuned: coarse_sign_test]
constexpr int kCoarsestSweeps = 40;      ///< sweeps on the coarsest level [tuned: coarse_sign_test]

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

/// Restrict by full weighting of 27 fine nodes, times 4: the equation is in units of the square of
/// the grid unit, which doubles.
void restrictTo(const NodeGrid& fine, const std::vector<float>& from, const NodeGrid& coarse,
                std::vector<float>& to)
{
    to.assign(coarse.size(), 0.0f);
    const Strides strides(fine);
    const int count = coarse.n[2] - 2;
    forEachRow(coarse, [&](int i, int j) {
        float* const row = &to[coarse.index(i, j, 1)];
        sumAround(&from[fine.index(2 * i, 2 * j, 2)], strides, count, row);
        for (int k = 0; k < count; ++k) row[k] *= 4.0f / 64.0f;
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

/// Over-relax every other node of a row, from @a first on. All are computed, which is faster than
/// to skip half of them.
MPUVDB_WIDE_CLONES
void relaxRow(float* u, const float* b, const float* screening, const Strides& next, int count,
              int first)
{
    const std::ptrdiff_t di = next.i, dj = next.j;
    constexpr int kStrip = 64; ///< nodes at once, even [free: a buffer's size]
    float change[kStrip];
    for (int begin = 0; begin < count;
         begin += kStrip, u += kStrip, b += kStrip, screening += kStrip) {
        const int part = std::min(kStrip, count - begin);
        for (int k = 0; k < part; ++k) {
            const float neighbors =
                (u[k - di] + u[k + di]) + (u[k - dj] + u[k + dj]) + (u[k - 1] + u[k + 1]);
            const float exact = (neighbors - b[k]) / (6 + screening[k]);
            change[k] = ((k ^ first) & 1) ? 0.0f : kOverRelaxation * (exact - u[k]);
        }
        for (int k = 0; k < part; ++k) u[k] += change[k];
    }
}

/// Set the residual of the equation at the nodes of a row.
MPUVDB_WIDE_CLONES
void residualRow(const float* u, const float* b, const float* screening, const Strides& next,
                 int count, float* residual)
{
    const std::ptrdiff_t di = next.i, dj = next.j;
    for (int k = 0; k < count; ++k) {
        const float neighbors =
            (u[k - di] + u[k + di]) + (u[k - dj] + u[k + dj]) + (u[k - 1] + u[k + 1]);
        residual[k] = b[k] - (neighbors - (6 + screening[k]) * u[k]);
    }
}

} // namespace

ScreenedPoisson::ScreenedPoisson(const NodeGrid& grid, std::vector<float> screening,
                                 Interrupter& progress)
    : mProgress(progress)
{
    mLevels.push_back({grid, std::move(screening), {}, {}});
    for (;;) {
        NodeGrid coarse = mLevels.back().grid;
        for (int& n : coarse.n) n = n / 2 + 1;
        if (*std::min_element(coarse.n.begin(), coarse.n.end()) < 3) break;
        const bool halves = std::all_of(mLevels.back().grid.n.begin(), mLevels.back().grid.n.end(),
                                        [](int n) { return n % 2 == 1; });
        if (!halves) break;
        Level level{coarse, {}, {}, {}};
        restrictTo(mLevels.back().grid, mLevels.back().screening, coarse, level.screening);
        mLevels.push_back(std::move(level));
    }
}

void ScreenedPoisson::relax(Level& level, int sweeps) const
{
    const NodeGrid& grid = level.grid;
    const Strides next(grid);
    for (int pass = 0; pass < 2 * sweeps; ++pass) {
        forEachRow(grid, [&](int i, int j) {
            const std::size_t n = grid.index(i, j, 1);
            relaxRow(&level.u[n], &level.b[n], &level.screening[n], next, grid.n[2] - 2,
                     (i + j + pass) & 1);
        });
    }
}

void ScreenedPoisson::cycle(std::size_t n)
{
    mProgress.check();
    Level& fine = mLevels[n];
    if (n + 1 == mLevels.size()) {
        relax(fine, kCoarsestSweeps);
        return;
    }
    relax(fine, 2);
    std::vector<float> residual(fine.grid.size(), 0.0f);
    const Strides next(fine.grid);
    forEachRow(fine.grid, [&](int i, int j) {
        const std::size_t m = fine.grid.index(i, j, 1);
        residualRow(&fine.u[m], &fine.b[m], &fine.screening[m], next, fine.grid.n[2] - 2,
                    &residual[m]);
    });
    Level& coarse = mLevels[n + 1];
    std::vector<float> keptU(coarse.grid.size(), 0.0f), keptB;
    restrictTo(fine.grid, residual, coarse.grid, keptB);
    keptU.swap(coarse.u);
    keptB.swap(coarse.b);
    cycle(n + 1);
    prolong(coarse.grid, coarse.u, fine.grid, fine.u, true);
    coarse.u.swap(keptU);
    coarse.b.swap(keptB);
    relax(fine, 2);
}

void ScreenedPoisson::descendRightHandSide(std::vector<float> b)
{
    mLevels[0].b = std::move(b);
    for (std::size_t n = 1; n < mLevels.size(); ++n)
        restrictTo(mLevels[n - 1].grid, mLevels[n - 1].b, mLevels[n].grid, mLevels[n].b);
}

void ScreenedPoisson::fillBorder(std::size_t n, const std::vector<float>& border)
{
    Level& level = mLevels[n];
    const NodeGrid& grid = level.grid;
    const int finest = 1 << n; // steps of the finest grid
    for (int i = 0; i < grid.n[0]; ++i)
        for (int j = 0; j < grid.n[1]; ++j)
            for (int k = 0; k < grid.n[2]; k += grid.borderStep(i, j))
                level.u[grid.index(i, j, k)] =
                    border[mLevels[0].grid.index(finest * i, finest * j, finest * k)];
}

std::vector<float> ScreenedPoisson::solve(std::vector<float> b, float border, int cycles)
{
    return solve(std::move(b), std::vector<float>(mLevels[0].grid.size(), border), cycles);
}

std::vector<float> ScreenedPoisson::solve(std::vector<float> b, const std::vector<float>& border,
                                          int cycles)
{
    descendRightHandSide(std::move(b));
    for (std::size_t n = mLevels.size(); n-- > 0;) {
        mProgress.check();
        Level& level = mLevels[n];
        level.u.resize(level.grid.size());
        if (n + 1 == mLevels.size()) {
            std::fill(level.u.begin(), level.u.end(), 0.0f);
            fillBorder(n, border);
            relax(level, kCoarsestSweeps);
            continue;
        }
        fillBorder(n, border);
        prolong(mLevels[n + 1].grid, mLevels[n + 1].u, level.grid, level.u, false);
        const int here = n == 0 ? cycles : 1;
        if (here == 0) relax(level, 2);
        for (int c = 0; c < here; ++c) cycle(n);
    }
    return std::exchange(mLevels[0].u, {});
}

} // namespace mpuvdb
