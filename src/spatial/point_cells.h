// The points of an index by the cubic cells of a lattice.
#pragma once
#include "point_index.h"

#include "core/morton.h"

namespace mpuvdb
{

/// The cells of a cubic lattice that hold points of an index. A cell's points are the index's own:
/// a few runs of places.
class PointCells
{
public:
    struct Run {
        std::uint32_t begin, end; ///< places in the index
    };
    struct Cell {
        Vec3i at;
        std::uint32_t firstRun, endRun;
        std::uint32_t points;

        std::uint32_t size() const { return points; }
    };

    /// @param index  outlives this.
    /// @param side   of a cell, world units, positive; made larger where the points' box would be
    /// more than 2^19 cells long. @throws Interrupted.
    PointCells(const PointIndex& index, double side, Interrupter& progress);

    const PointIndex& index() const { return mIndex; }
    double side() const { return mSide; }
    /// In Morton order.
    const std::vector<Cell>& cells() const { return mCells; }
    const Run* begin(const Cell& cell) const { return mRuns.data() + cell.firstRun; }
    const Run* end(const Cell& cell) const { return mRuns.data() + cell.endRun; }
    /// Call f(place) for the points of a cell.
    template <class F>
    void forEachPoint(const Cell& cell, F&& f) const
    {
        for (const Run* run = begin(cell); run != end(cell); ++run)
            for (std::uint32_t n = run->begin; n < run->end; ++n) f(n);
    }
    /// The point of a cell whose position is the first by x, y, z.
    std::uint32_t firstOf(const Cell& cell) const;
    /// The points of a cell by x, y, z: in an order that depends on nothing else.
    std::vector<std::uint32_t> byPosition(const Cell& cell) const;
    Vec3d center(const Cell& cell) const
    {
        return mCorner + mSide * (cell.at.cast<double>().array() + 0.5).matrix();
    }
    /// Call f(index) for the cells among the 26 around @a cell that there are.
    template <class F>
    void forEachAround(const Cell& cell, F&& f) const
    {
        // They lie in eight cubes of eight cells, each a range of keys.
        const Vec3i low = (cell.at.array() - 1) / 2;
        for (int n = 0; n < 8; ++n) {
            const std::uint64_t key = keyOf(low + Vec3i(n & 1, n >> 1 & 1, n >> 2 & 1)) << 3;
            for (std::uint32_t c = firstFrom(key); c < mKeys.size() && mKeys[c] < key + 8; ++c) {
                const int apart = (mCells[c].at - cell.at).cwiseAbs().maxCoeff();
                if (apart == 1) f(c);
            }
        }
    }
    /// The same for the three that share a face and come after it: every such pair is visited once.
    template <class F>
    void forFacesAfter(const Cell& cell, F&& f) const
    {
        for (int axis = 0; axis < 3; ++axis) {
            const std::uint64_t key = keyOf(cell.at + Vec3i::Unit(axis));
            const std::uint32_t c = firstFrom(key);
            if (c < mKeys.size() && mKeys[c] == key) f(c);
        }
    }

private:
    static std::uint64_t keyOf(const Vec3i& at)
    {
        return mortonKey(std::uint64_t(at.x()), std::uint64_t(at.y()), std::uint64_t(at.z()));
    }
    /// The first cell whose key is @a key or more.
    std::uint32_t firstFrom(std::uint64_t key) const
    {
        std::uint32_t c = mTop[key >> mTopShift];
        while (c < mKeys.size() && mKeys[c] < key) ++c;
        return c;
    }
    Vec3i cellAt(const Vec3f& p) const
    {
        return ((p.cast<double>() - mCorner) / mSide).cast<int>();
    }
    void findCells(Interrupter& progress);
    void makeTop();

    const PointIndex& mIndex;
    double mSide;
    Vec3d mCorner = Vec3d::Zero();
    int mBits = 0; ///< of a cell's place along an axis
    std::vector<Run> mRuns;
    std::vector<Cell> mCells;
    std::vector<std::uint64_t> mKeys; ///< of the cells
    int mTopShift = 0;
    std::vector<std::uint32_t> mTop; ///< the first cell from those upper bits of a key on
};

/// A point that was found among those of a cell.
struct PointInCell {
    std::uint32_t point, cell;
};

/// Of each cell whether it or one around it holds one of @a found: only there a second look, which
/// knows of these, may find something else.
std::vector<char> cellsAbout(const PointCells& cells, const std::vector<PointInCell>& found);

} // namespace mpuvdb
