#include "tension_spline.h"

#include "core/clones.h"
#include "core/lanes.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <tbb/parallel_for.h>
#include <utility>

namespace mpuvdb
{

/// Every other interior node of a row of a level: those that are relaxed at once.
struct SplineRow {
    float* u[3];          ///< of the first
    const float* side[3]; ///< of the node before it; the one after it is the next of that array
    const float* b[3];
    const float* weight;
    std::ptrdiff_t di, dj; ///< to the next plane and row
    float scale;           ///< of second differences: 1 / step^2
    int count;
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

// A row's nodes are stored by color, as relaxation takes them: the even ones, then the odd ones.

/// Even nodes of a row of @a n, which come first.
constexpr int evenOf(int n)
{
    return (n + 1) / 2;
}

/// The place of node k in a row.
constexpr int placeOf(int n, int k)
{
    return k % 2 == 0 ? k / 2 : evenOf(n) + k / 2;
}

/// Change the order of @a values, as a row's nodes follow each other, to that by color; or back.
void sortByColor(const NodeGrid& grid, std::vector<float>& values, bool back)
{
    const int n = grid.n[2];
    const auto sortPlane = [&](int i) {
        std::vector<float> from(std::size_t(n), 0.0f);
        for (int j = 0; j < grid.n[1]; ++j) {
            float* const row = &values[grid.index(i, j, 0)];
            std::copy_n(row, n, from.begin());
            for (int k = 0; k < n; ++k) {
                const auto place = std::size_t(placeOf(n, k));
                if (back)
                    row[k] = from[place];
                else
                    row[place] = from[std::size_t(k)];
            }
        }
    };
    if (grid.size() > kMinParallelNodes)
        tbb::parallel_for(0, grid.n[0], sortPlane);
    else
        for (int i = 0; i < grid.n[0]; ++i) sortPlane(i);
}

/// Set sums[k], for 0 <= k < count, to the sum of the 27 nodes about the k-th interior even one of
/// a row, weighted 1 to 8. @param from  the row.
MPUVDB_WIDE_CLONES
void sumAround(const float* from, int odd, const Strides& fine, int count, float* sums)
{
    std::fill_n(sums, count, 0.0f);
    for (int di = -1; di <= 1; ++di)
        for (int dj = -1; dj <= 1; ++dj) {
            const float* const row = from + di * fine.i + dj * fine.j;
            const auto side = float((2 - std::abs(di)) * (2 - std::abs(dj))), middle = 2 * side;
            for (int k = 0; k < count; ++k) {
                float sum = sums[k];
                sum += side * row[odd + k];
                sum += middle * row[k + 1];
                sum += side * row[odd + k + 1];
                sums[k] = sum;
            }
        }
}

/// Means of 27 fine interior nodes at the coarse interior nodes.
std::vector<float> restricted(const NodeGrid& fine, const std::vector<float>& from,
                              const NodeGrid& coarse)
{
    std::vector<float> to(coarse.size(), 0.0f);
    const Strides strides(fine);
    const int count = coarse.n[2] - 2, odd = evenOf(fine.n[2]);
    forEachRow(coarse, [&](int i, int j) {
        float* const row = &to[coarse.index(i, j, 1)];
        sumAround(&from[fine.index(2 * i, 2 * j, 0)], odd, strides, count, row);
        for (int k = 0; k < count; ++k) row[k] *= 1.0f / 64.0f;
    });
    sortByColor(coarse, to, false);
    return to;
}

/// Trilinear interpolation between four rows of @a count + 1 coarse nodes, added to or assigned to
/// the even fine nodes and to the odd ones.
MPUVDB_WIDE_CLONES
void interpolateRows(const float* const (&rows)[4], int count, bool add, float* even, float* odd)
{
    const float *const r0 = rows[0], *const r1 = rows[1], *const r2 = rows[2], *const r3 = rows[3];
    if (!add) {
        std::fill_n(even, count, 0.0f);
        std::fill_n(odd, count, 0.0f);
    }
    for (int k = 0; k < count; ++k) {
        const float at = (r0[k] + r0[k]) + (r1[k] + r1[k]) + (r2[k] + r2[k]) + (r3[k] + r3[k]);
        const float between =
            (r0[k] + r0[k + 1]) + (r1[k] + r1[k + 1]) + (r2[k] + r2[k + 1]) + (r3[k] + r3[k + 1]);
        even[k] += at * 0.125f;
        odd[k] += between * 0.125f;
    }
}

/// Trilinear interpolation of the coarse values at fine interior nodes, added or assigned.
void prolong(const NodeGrid& coarse, std::vector<float> from, const NodeGrid& fine,
             std::vector<float>& to, bool add)
{
    sortByColor(coarse, from, true);
    forEachRow(fine, [&](int i, int j) {
        const int i0 = i / 2, i1 = (i + 1) / 2, j0 = j / 2, j1 = (j + 1) / 2;
        const float* const rows[4] = {
            &from[coarse.index(i0, j0, 0)], &from[coarse.index(i0, j1, 0)],
            &from[coarse.index(i1, j0, 0)], &from[coarse.index(i1, j1, 0)]};
        float* const row = &to[fine.index(i, j, 0)];
        const float border = row[0];
        interpolateRows(rows, coarse.n[2] - 1, add, row, row + evenOf(fine.n[2]));
        row[0] = border;
    });
}

/// Relax the three unknowns of the k-th of a row's nodes, and of those after it that a vector
/// takes, together.
template <typename Lanes>
[[gnu::always_inline]] inline void relaxAt(const SplineRow& row, int k)
{
    const std::ptrdiff_t di = row.di, dj = row.dj;
    const float scale = row.scale, diagonal = 6 * scale, bend = diagonal + kBendShare;
    const float pivot = (bend * diagonal + kSlopeShare) * diagonal;
    Lanes next[3];
    for (std::size_t c = 0; c < 3; ++c) {
        const float *const u = row.u[c] + k, *const side = row.side[c] + k;
        next[c] = scale * ((lanesAt<Lanes>(u - di) + lanesAt<Lanes>(u + di)) +
                           (lanesAt<Lanes>(u - dj) + lanesAt<Lanes>(u + dj)) +
                           (lanesAt<Lanes>(side) + lanesAt<Lanes>(side + 1)));
    }
    // Lap u = -p - diagonal u, Lap Lap u = diagonal (p + diagonal u) - q.
    const Lanes p = lanesAt<Lanes>(row.b[0] + k) - next[0],
                q = lanesAt<Lanes>(row.b[1] + k) - next[1],
                r = lanesAt<Lanes>(row.b[2] + k) + next[2];
    const Lanes u = (r - bend * (diagonal * p - q) - kSlopeShare * p) /
                    (pivot + lanesAt<Lanes>(row.weight + k));
    const Lanes turn = p + diagonal * u, back = -turn, rest = diagonal * turn - q;
    std::memcpy(row.u[0] + k, &u, sizeof u);
    std::memcpy(row.u[1] + k, &back, sizeof back);
    std::memcpy(row.u[2] + k, &rest, sizeof rest);
}

/// The same for all nodes of a row. Those that the last vector shares with the one before it get
/// what they have: a node's next values do not depend on its last.
/// @tparam kLanes  numbers of a vector.
template <typename Lanes, int kLanes>
[[gnu::always_inline]] inline void relaxBy(const SplineRow& row)
{
    int k = 0;
    for (; k + kLanes <= row.count; k += kLanes) relaxAt<Lanes>(row, k);
    if (k < row.count) relaxAt<Lanes>(row, row.count - kLanes);
}

MPUVDB_WIDE_CLONES
void relaxRow(const SplineRow& row)
{
    using Four = float __attribute__((vector_size(16)));
    using Sixteen = float __attribute__((vector_size(64)));
    if (row.count >= 16)
        relaxBy<Sixteen, 16>(row);
    else if (row.count >= 4)
        relaxBy<Four, 4>(row);
    else
        relaxBy<float, 1>(row);
}

/// Set the residual of an equation at the nodes of a row.
MPUVDB_WIDE_CLONES
void residualRow(const SplineRow& row, std::size_t equation, float* residual)
{
    const std::ptrdiff_t di = row.di, dj = row.dj;
    const int count = row.count;
    const float *const u = row.u[equation], *const side = row.side[equation];
    const float* const b = row.b[equation];
    const float scale = row.scale;
    for (int k = 0; k < count; ++k) {
        const float sum =
            (u[k - di] + u[k + di]) + (u[k - dj] + u[k + dj]) + (side[k] + side[k + 1]);
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
    sortByColor(grid, weight, false);
    mLevels.push_back({grid, 1, std::move(weight), {}, {}});
    for (;;) {
        const Level& fine = mLevels.back();
        NodeGrid coarse = fine.grid;
        for (int& n : coarse.n) n = n / 2 + 1;
        if (*std::min_element(coarse.n.begin(), coarse.n.end()) < 3) break;
        if (!std::all_of(fine.grid.n.begin(), fine.grid.n.end(), [](int n) { return n % 2 == 1; }))
            break;
        mLevels.push_back(
            {coarse, 2 * fine.step, restricted(fine.grid, fine.weight, coarse), {}, {}});
    }
}

/// The even nodes of the row (i, j) of a level, or its odd ones.
SplineRow TensionSpline::rowOf(Level& level, int i, int j, bool odd) const
{
    const int even = evenOf(level.grid.n[2]);
    const std::size_t row = level.grid.index(i, j, 0);
    const std::size_t first = row + std::size_t(odd ? even : 1);
    const Strides next(level.grid);
    SplineRow nodes;
    for (std::size_t c = 0; c < 3; ++c) {
        nodes.u[c] = &level.u[c][first];
        nodes.side[c] = &level.u[c][row + std::size_t(odd ? 0 : even)];
        nodes.b[c] = level.b[c].empty() ? mNone.data() : &level.b[c][first];
    }
    nodes.weight = &level.weight[first];
    nodes.di = next.i;
    nodes.dj = next.j;
    nodes.scale = 1 / (level.step * level.step);
    const int n = level.grid.n[2], odds = (n - 1) / 2; // interior ones
    nodes.count = odd ? odds : n - 2 - odds;
    return nodes;
}

void TensionSpline::relax(Level& level, int sweeps) const
{
    for (int pass = 0; pass < 2 * sweeps; ++pass)
        forEachRow(level.grid,
                   [&](int i, int j) { relaxRow(rowOf(level, i, j, (i + j + pass) % 2 == 0)); });
}

void TensionSpline::restrictResidual(Level& fine, Level& coarse)
{
    for (std::size_t equation = 0; equation < 3; ++equation) {
        forEachRow(fine.grid, [&](int i, int j) {
            float* const row = &mResidual[fine.grid.index(i, j, 0)];
            residualRow(rowOf(fine, i, j, false), equation, row + 1);
            residualRow(rowOf(fine, i, j, true), equation, row + evenOf(fine.grid.n[2]));
        });
        coarse.b[equation] = restricted(fine.grid, mResidual, coarse.grid);
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
                u[grid.index(i, j, placeOf(grid.n[2], k))] =
                    border[mLevels[0].grid.index(finest * i, finest * j, finest * k)];
}

std::vector<float> TensionSpline::solve(std::vector<float> data, const std::vector<float>& border,
                                        const std::vector<float>& bend, int cycles)
{
    for (Level& level : mLevels)
        for (std::size_t c = 0; c < 3; ++c) {
            level.u[c].assign(level.grid.size(), 0.0f);
            level.b[c].clear();
        }
    sortByColor(mLevels[0].grid, data, false);
    for (std::size_t n = 0; n < data.size(); ++n) data[n] *= mLevels[0].weight[n];
    mLevels[0].b[2] = std::move(data);
    for (std::size_t n = 1; n < mLevels.size(); ++n)
        mLevels[n].b[2] = restricted(mLevels[n - 1].grid, mLevels[n - 1].b[2], mLevels[n].grid);
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
    sortByColor(mLevels[0].grid, mLevels[0].u[0], true);
    return std::exchange(mLevels[0].u[0], {});
}

} // namespace mpuvdb
