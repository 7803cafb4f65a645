#include "multigrid.h"

#include <mpuvdb/clones.h>
#include <mpuvdb/progress.h>

#include <algorithm>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

constexpr float kOverRelaxation = 1.15f;
constexpr int kCoarsestSweeps = 40;

/// Call f(i, j) for every interior row of the grid, in parallel; rows are independent.
template <typename F>
void forEachRow(const NodeGrid& grid, F f)
{
    tbb::parallel_for(1, grid.n[0] - 1, [&](int i) {
        for (int j = 1; j < grid.n[1] - 1; ++j) f(i, j);
    });
}

/// Full weighting of 27 fine nodes, times 4: the grid unit doubles, and the equation is in units of
/// its square.
void restrictTo(const NodeGrid& fine, const std::vector<float>& from, const NodeGrid& coarse,
                std::vector<float>& to)
{
    to.assign(coarse.size(), 0.0f);
    forEachRow(coarse, [&](int i, int j) {
        for (int k = 1; k < coarse.n[2] - 1; ++k) {
            float sum = 0;
            for (int di = -1; di <= 1; ++di)
                for (int dj = -1; dj <= 1; ++dj)
                    for (int dk = -1; dk <= 1; ++dk) {
                        const float w =
                            float((2 - std::abs(di)) * (2 - std::abs(dj)) * (2 - std::abs(dk)));
                        sum += w * from[fine.index(2 * i + di, 2 * j + dj, 2 * k + dk)];
                    }
            to[coarse.index(i, j, k)] = sum * (4.0f / 64.0f);
        }
    });
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
        for (int k = 1; k < fine.n[2] - 1; ++k) {
            const int k0 = k / 2, k1 = (k + 1) / 2;
            float sum = 0;
            for (const float* row : rows) sum += row[k0] + row[k1];
            float& value = to[fine.index(i, j, k)];
            value = (add ? value : 0.0f) + sum * 0.125f;
        }
    });
}

/// Over-relax every other node of a row, from @a first on; those between are their neighbours and
/// stay. All are computed: that is cheaper than to step over half of them.
MPUVDB_CLONES
void relaxRow(float* u, const float* b, const float* screening, std::ptrdiff_t di,
              std::ptrdiff_t dj, int count, int first)
{
    constexpr int kPart = 64; // even
    float change[kPart];
    for (int begin = 0; begin < count; begin += kPart, u += kPart, b += kPart, screening += kPart) {
        const int part = std::min(kPart, count - begin);
        for (int k = 0; k < part; ++k) {
            const float neighbours =
                (u[k - di] + u[k + di]) + (u[k - dj] + u[k + dj]) + (u[k - 1] + u[k + 1]);
            const float exact = (neighbours - b[k]) / (6 + screening[k]);
            change[k] = ((k ^ first) & 1) ? 0.0f : kOverRelaxation * (exact - u[k]);
        }
        for (int k = 0; k < part; ++k) u[k] += change[k];
    }
}

} // namespace

ScreenedPoisson::ScreenedPoisson(const NodeGrid& grid, std::vector<float> screening,
                                 Progress& progress)
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
    for (Level& level : mLevels) level.u.assign(level.grid.size(), 0.0f);
}

void ScreenedPoisson::relax(Level& level, int sweeps) const
{
    const NodeGrid& grid = level.grid;
    const std::size_t di = std::size_t(grid.n[1]) * std::size_t(grid.n[2]),
                      dj = std::size_t(grid.n[2]);
    for (int pass = 0; pass < 2 * sweeps; ++pass) {
        forEachRow(grid, [&](int i, int j) {
            const std::size_t n = grid.index(i, j, 1);
            relaxRow(&level.u[n], &level.b[n], &level.screening[n], std::ptrdiff_t(di),
                     std::ptrdiff_t(dj), grid.n[2] - 2, (i + j + pass) & 1);
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
    const std::size_t di = std::size_t(fine.grid.n[1]) * std::size_t(fine.grid.n[2]),
                      dj = std::size_t(fine.grid.n[2]);
    forEachRow(fine.grid, [&](int i, int j) {
        for (int k = 1; k < fine.grid.n[2] - 1; ++k) {
            const std::size_t m = fine.grid.index(i, j, k);
            const float* const u = &fine.u[m];
            const float neighbours = (u[-std::ptrdiff_t(di)] + u[di]) +
                                     (u[-std::ptrdiff_t(dj)] + u[dj]) + (u[-1] + u[1]);
            residual[m] = fine.b[m] - (neighbours - (6 + fine.screening[m]) * u[0]);
        }
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

void ScreenedPoisson::descendRightHandSide(const std::vector<float>& b)
{
    mLevels[0].b = b;
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
            for (int k = 0; k < grid.n[2]; ++k)
                if (grid.onBorder(i, j, k))
                    level.u[grid.index(i, j, k)] =
                        border[mLevels[0].grid.index(finest * i, finest * j, finest * k)];
}

std::vector<float> ScreenedPoisson::solve(const std::vector<float>& b, float border, int cycles)
{
    return solve(b, std::vector<float>(mLevels[0].grid.size(), border), cycles);
}

std::vector<float> ScreenedPoisson::solve(const std::vector<float>& b,
                                          const std::vector<float>& border, int cycles)
{
    descendRightHandSide(b);
    for (std::size_t n = mLevels.size(); n-- > 0;) {
        mProgress.check();
        Level& level = mLevels[n];
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
    return mLevels[0].u;
}

} // namespace mpuvdb
