#include "point_cells.h"

#include "key_order.h"
#include "position_order.h"

#include "core/parallel_each.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace mpuvdb
{
namespace
{

constexpr std::size_t kEntries = 4;     // of the table, for a cell; [free: the same cells]
constexpr std::size_t kGrain = 1 << 13; // points; [free: the same cells]
struct RunInCell {
    Vec3i at;
    PointCells::Run run;
};

/// The bits of a cell's place along an axis. [derived: two fewer than mortonKey() takes]
constexpr int kMostBits = 19;

} // namespace

PointCells::PointCells(const PointIndex& index, double side, Interrupter& progress)
    : mIndex(index), mSide(side)
{
    if (index.size() == 0) return;
    const Box3d box = index.bounds().cast<double>();
    const double longest = box.sizes().maxCoeff();
    mSide = std::max({side, std::ldexp(longest, -kMostBits), 1e-300});
    // One cell is kept free below, so that those around cells of the border have keys too.
    mCorner = box.min().array() - 1.5 * mSide;
    while (std::ldexp(mSide, mBits) < longest + 4 * mSide) ++mBits;
    findCells(progress);
    makeTop();
}

void PointCells::findCells(Interrupter& progress)
{
    // Runs of places in one cell: what the index has together mostly is.
    const std::size_t chunks = (mIndex.size() + kGrain - 1) / kGrain;
    const auto findRuns = [&](std::size_t chunk, std::vector<RunInCell>& runs) {
        const auto last = std::uint32_t(std::min((chunk + 1) * kGrain, mIndex.size()));
        for (auto n = std::uint32_t(chunk * kGrain); n < last; ++n) {
            const Vec3i at = cellAt(mIndex[n]);
            if (runs.empty() || runs.back().at != at) runs.push_back({at, {n, n}});
            ++runs.back().run.end;
        }
    };
    const std::vector<RunInCell> found = gatherParallel<RunInCell>(chunks, 1, progress, findRuns);
    mRuns.reserve(found.size());
    for (const std::uint32_t n : orderByKeys(
             found.size(), 3 * mBits, [&](std::uint32_t r) { return keyOf(found[r].at); },
             progress)) {
        const auto& [at, run] = found[n];
        const std::uint64_t key = keyOf(at);
        const auto r = std::uint32_t(mRuns.size());
        if (mKeys.empty() || mKeys.back() != key) {
            mKeys.push_back(key);
            mCells.push_back({at, r, r, 0});
        }
        mRuns.push_back(run);
        ++mCells.back().endRun;
        mCells.back().points += run.end - run.begin;
    }
}

void PointCells::makeTop()
{
    int bits = 0; // of keys: some entries for each cell
    while (bits < 3 * mBits && (kEntries * mKeys.size() >> bits) > 0) ++bits;
    mTopShift = 3 * mBits - bits;
    mTop.reserve((std::size_t(1) << bits) + 1);
    for (std::uint32_t c = 0; c < mKeys.size(); ++c)
        while (mTop.size() <= mKeys[c] >> mTopShift) mTop.push_back(c);
    mTop.resize((std::size_t(1) << bits) + 1, std::uint32_t(mKeys.size()));
}

std::uint32_t PointCells::firstOf(const Cell& cell) const
{
    std::uint32_t first = begin(cell)->begin;
    forEachPoint(cell, [&](std::uint32_t n) {
        if (positionBefore(mIndex[n], mIndex[first])) first = n;
    });
    return first;
}

std::vector<std::uint32_t> PointCells::byPosition(const Cell& cell) const
{
    std::vector<std::uint32_t> places;
    forEachPoint(cell, [&](std::uint32_t n) { places.push_back(n); });
    std::stable_sort(places.begin(), places.end(), [&](std::uint32_t a, std::uint32_t b) {
        return positionBefore(mIndex[a], mIndex[b]);
    });
    return places;
}

std::vector<char> cellsAbout(const PointCells& cells, const std::vector<PointInCell>& found)
{
    constexpr char kAlone = 1, kWithAround = 2; // [free: states]
    std::vector<char> isAbout(cells.cells().size(), 0);
    for (const PointInCell& f : found) {
        if (std::exchange(isAbout[f.cell], kWithAround) == kWithAround) continue;
        cells.forEachAround(cells.cells()[f.cell], [&](std::uint32_t c) {
            if (!isAbout[c]) isAbout[c] = kAlone;
        });
    }
    return isAbout;
}

} // namespace mpuvdb
