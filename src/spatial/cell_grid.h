// Points sorted into the cells of an unbounded grid: the cheap way to ask what is near.
#pragma once
#include <mpuvdb/vec.h>

#include <cstdint>
#include <cstdlib>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// Cubic cells that hold points, found by hashing. Built part by part so that each part's table
/// fits a cache.
class CellGrid
{
public:
    static constexpr std::uint32_t kNone = 0xffffffffu;

    struct Cell {
        Vec3i at;
        std::uint32_t begin, end; ///< into order()
        std::uint32_t size() const { return end - begin; }
    };

    /// @param side  of a cell, positive; made larger where the positions' box would be more than
    /// 2^19 cells long. @throws Interrupted.
    CellGrid(const std::vector<Vec3f>& positions, double side, Interrupter& progress);

    double side() const { return mSide; }
    /// In no particular order, but the same for any number of threads and order of the points.
    const std::vector<Cell>& cells() const { return mCells; }
    /// Indices of the points, cell by cell, by position in each.
    const std::vector<std::uint32_t>& order() const { return mOrder; }
    /// Their positions, in that order.
    const std::vector<Vec3f>& positions() const { return mPositions; }
    /// Index of the cell at @a at, or kNone.
    std::uint32_t find(const Vec3i& at) const;
    Vec3d center(const Cell& cell) const
    {
        return mCorner + mSide * (cell.at.cast<double>().array() + 0.5).matrix();
    }
    /// Call f(index) for the cells among the 26 around @a cell that there are.
    template <class F>
    void forEachAround(const Cell& cell, F&& f) const
    {
        for (int n = 0; n < 27; ++n)
            if (n != 13) visit(cell, n, f);
    }
    /// The same for those @a ring cells away, in the largest of the three directions.
    template <class F>
    void forEachOfRing(const Cell& cell, int ring, F&& f) const
    {
        for (int x = -ring; x <= ring; ++x)
            for (int y = -ring; y <= ring; ++y) {
                const bool side = std::abs(x) == ring || std::abs(y) == ring;
                for (int z = -ring; z <= ring; z += side ? 1 : 2 * ring) {
                    const Vec3i at = cell.at + Vec3i(x, y, z);
                    if (at.minCoeff() < 0) continue; // no key
                    const std::uint32_t found = find(at);
                    if (found != kNone) f(found);
                }
            }
    }
    /// The same for the three that share a face and come after it: every such pair is visited once.
    template <class F>
    void forFacesAfter(const Cell& cell, F&& f) const
    {
        for (const int n : {14, 16, 22}) visit(cell, n, f);
    }

private:
    struct Record;
    struct Part {
        std::vector<Cell> cells;          ///< while they are found
        std::vector<std::uint32_t> slots; ///< hash table of places in cells
        std::uint32_t firstCell = 0;      ///< its cells' place in mCells
    };

    template <class F>
    void visit(const Cell& cell, int n, F&& f) const
    {
        const std::uint32_t found = find(cell.at + Vec3i(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1));
        if (found != kNone) f(found);
    }
    std::uint64_t keyAt(const Vec3f& p) const;
    void sortPart(const Record* records, std::size_t begin, std::size_t end, Part& part);

    double mSide;
    Vec3d mCorner = Vec3d::Zero();
    int mPartBits = 0;
    std::vector<Part> mParts;
    std::vector<Cell> mCells;
    std::vector<std::uint32_t> mOrder;
    std::vector<Vec3f> mPositions;
};

/// A point that was found among those of a cell.
struct PointInCell {
    std::uint32_t point, cell;
};

/// Of each cell whether it or one around it holds one of @a found: only there a second look, which
/// knows of these, may find something else.
std::vector<char> cellsAbout(const CellGrid& grid, const std::vector<PointInCell>& found);

} // namespace mpuvdb
