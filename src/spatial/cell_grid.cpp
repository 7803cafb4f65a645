#include "cell_grid.h"

#include "position_order.h"

#include "core/release.h"
#include <mpuvdb/interrupter.h>

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

namespace mpuvdb
{
namespace
{

constexpr std::size_t kPartPoints = 8192;
constexpr int kMostPartBits = 16;
constexpr std::size_t kSlices = 16;
constexpr int kKeyBits = 21; // per axis
constexpr std::uint64_t kKeyMask = (1u << kKeyBits) - 1;

std::uint64_t keyOf(const Vec3i& at)
{
    return std::uint64_t(at.x()) << (2 * kKeyBits) | std::uint64_t(at.y()) << kKeyBits |
           std::uint64_t(at.z());
}

Vec3i cellOf(std::uint64_t key)
{
    return {int(key >> (2 * kKeyBits)), int(key >> kKeyBits & kKeyMask), int(key & kKeyMask)};
}

std::uint64_t hashOf(std::uint64_t key)
{
    const std::uint64_t h = key * 0x9e3779b97f4a7c15u;
    return h ^ (h >> 32);
}

/// Neighbors are mostly in one block of 8 x 8 x 8 cells, and blocks in one part: what is asked for
/// together lies together.
std::size_t partOf(std::uint64_t key, int partBits)
{
    constexpr std::uint64_t kWithin = 7ull << (2 * kKeyBits) | 7ull << kKeyBits | 7ull;
    return partBits == 0 ? 0 : std::size_t(hashOf(key & ~kWithin) >> (64 - partBits));
}

std::size_t slotOf(std::uint64_t key, std::size_t slots)
{
    return std::size_t(hashOf(key) >> 8) & (slots - 1);
}

/// Place in @a slots of the cell with this key, or of the empty slot where it belongs.
template <class Cells>
std::size_t findSlot(const std::vector<std::uint32_t>& slots, const Cells& cells, const Vec3i& at)
{
    std::size_t slot = slotOf(keyOf(at), slots.size());
    while (slots[slot] != CellGrid::kNone && cells[slots[slot]].at != at)
        slot = (slot + 1) & (slots.size() - 1);
    return slot;
}

Box3d boundsOf(const std::vector<Vec3f>& positions)
{
    Eigen::AlignedBox3f box;
    for (const Vec3f& p : positions) box.extend(p);
    return Box3d(box.min().cast<double>(), box.max().cast<double>());
}

} // namespace

/// A point on its way to its part.
struct CellGrid::Record {
    std::uint64_t key;
    Vec3f position;
    std::uint32_t point;
};

std::uint64_t CellGrid::keyAt(const Vec3f& p) const
{
    // One cell is kept free below, so that neighbors of border cells have keys too.
    return keyOf(((p.cast<double>() - mCorner) / mSide).cast<int>());
}

CellGrid::CellGrid(const std::vector<Vec3f>& positions, double side, Interrupter& progress)
    : mSide(side)
{
    const std::size_t points = positions.size();
    if (points == 0) return;
    const Box3d box = boundsOf(positions);
    mSide = std::max({side, std::ldexp(box.sizes().maxCoeff(), -19), 1e-300});
    mCorner = box.min().array() - 1.5 * mSide;
    while (mPartBits < kMostPartBits && (points >> mPartBits) > kPartPoints) ++mPartBits;
    const std::size_t parts = std::size_t(1) << mPartBits;
    const auto sliceStart = [&](std::size_t slice) { return points * slice / kSlices; };

    std::vector<std::vector<std::size_t>> next(kSlices, std::vector<std::size_t>(parts, 0));
    tbb::parallel_for(std::size_t(0), kSlices, [&](std::size_t s) {
        progress.check();
        for (std::size_t i = sliceStart(s); i < sliceStart(s + 1); ++i)
            ++next[s][partOf(keyAt(positions[i]), mPartBits)];
    });
    std::vector<std::size_t> starts;
    std::size_t start = 0;
    for (std::size_t part = 0; part < parts; ++part) {
        starts.push_back(start);
        for (auto& slice : next) start += std::exchange(slice[part], start);
    }
    starts.push_back(start);
    const std::unique_ptr<Record[]> records(new Record[points]); // not cleared: all are written
    tbb::parallel_for(std::size_t(0), kSlices, [&](std::size_t s) {
        progress.check();
        for (std::size_t i = sliceStart(s); i < sliceStart(s + 1); ++i) {
            const std::uint64_t key = keyAt(positions[i]);
            records[next[s][partOf(key, mPartBits)]++] = {key, positions[i], std::uint32_t(i)};
        }
    });
    mParts.resize(parts);
    mOrder.resize(points);
    mPositions.resize(points);
    tbb::parallel_for(std::size_t(0), parts, [&](std::size_t p) {
        progress.check();
        sortPart(records.get(), starts[p], starts[p + 1], mParts[p]);
    });
    for (Part& part : mParts) {
        part.firstCell = std::uint32_t(mCells.size());
        mCells.insert(mCells.end(), part.cells.begin(), part.cells.end());
        release(part.cells);
    }
}

void CellGrid::sortPart(const Record* records, std::size_t begin, std::size_t end, Part& part)
{
    constexpr std::size_t kFewestSlots = 1024;
    part.slots.assign(kFewestSlots, kNone);
    std::vector<std::uint32_t> cellOfRecord(end - begin);
    for (std::size_t r = begin; r < end; ++r) {
        const Vec3i at = cellOf(records[r].key);
        std::size_t slot = findSlot(part.slots, part.cells, at);
        if (part.slots[slot] == kNone) {
            part.slots[slot] = std::uint32_t(part.cells.size());
            part.cells.push_back({at, 0, 0});
        }
        const std::uint32_t cell = part.slots[slot];
        ++part.cells[cell].end; // counts first
        cellOfRecord[r - begin] = cell;
        if (2 * part.cells.size() < part.slots.size()) continue;
        part.slots.assign(4 * part.slots.size(), kNone);
        for (std::uint32_t c = 0; c < part.cells.size(); ++c)
            part.slots[findSlot(part.slots, part.cells, part.cells[c].at)] = c;
    }
    std::uint32_t start = 0;
    for (Cell& cell : part.cells) {
        const std::uint32_t size = cell.end;
        cell.begin = cell.end = start;
        start += size;
    }
    struct Sorted {
        Vec3f position;
        std::uint32_t point;
    };
    std::vector<Sorted> sorted(end - begin);
    for (std::size_t r = begin; r < end; ++r)
        sorted[part.cells[cellOfRecord[r - begin]].end++] = {records[r].position, records[r].point};
    for (Cell& cell : part.cells) {
        // Whatever the order of the points was, theirs in the grid is the same.
        std::sort(sorted.begin() + cell.begin, sorted.begin() + cell.end,
                  [](const Sorted& a, const Sorted& b) {
                      return positionBefore(a.position, b.position);
                  });
        cell.begin += std::uint32_t(begin);
        cell.end += std::uint32_t(begin);
    }
    for (std::size_t n = 0; n < sorted.size(); ++n) {
        mOrder[begin + n] = sorted[n].point;
        mPositions[begin + n] = sorted[n].position;
    }
    std::sort(part.cells.begin(), part.cells.end(),
              [](const Cell& a, const Cell& b) { return keyOf(a.at) < keyOf(b.at); });
    std::fill(part.slots.begin(), part.slots.end(), kNone);
    for (std::uint32_t c = 0; c < part.cells.size(); ++c)
        part.slots[findSlot(part.slots, part.cells, part.cells[c].at)] = c;
}

std::uint32_t CellGrid::find(const Vec3i& at) const
{
    const std::uint64_t key = keyOf(at);
    const Part& part = mParts[partOf(key, mPartBits)];
    const std::uint32_t found =
        part.slots[findSlot(part.slots, mCells.data() + part.firstCell, at)];
    return found == kNone ? kNone : part.firstCell + found;
}

std::vector<char> cellsAbout(const CellGrid& grid, const std::vector<PointInCell>& found)
{
    constexpr char kAlone = 1, kWithAround = 2;
    std::vector<char> isAbout(grid.cells().size(), 0);
    for (const PointInCell& f : found) {
        if (std::exchange(isAbout[f.cell], kWithAround) == kWithAround) continue;
        grid.forEachAround(grid.cells()[f.cell], [&](std::uint32_t c) {
            if (!isAbout[c]) isAbout[c] = kAlone;
        });
    }
    return isAbout;
}

} // namespace mpuvdb
