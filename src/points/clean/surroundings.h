// The points about those of a cell, as far as one has to look.
#pragma once
#include "spatial/point_cells.h"

#include <cmath>
#include <cstdint>
#include <vector>

namespace mpuvdb
{

/// Looks about the points of one cell after the other. Points that are flagged are not there.
class Surroundings
{
public:
    struct Near {
        float squared; ///< distance
        std::uint32_t point;
    };

    Surroundings(const std::vector<Vec3f>& positions, const PointCells& cells,
                 const std::vector<char>& flags)
        : mPositions(positions), mCells(cells), mIndex(cells.index()), mFlags(flags)
    {
    }

    void enter(const PointCells::Cell& cell);
    /// The cell's points.
    const std::vector<std::uint32_t>& points() const { return mPoints; }
    /// The spacing of the points in the cell and around it, where they are most.
    double spacing() const { return mSpacing; }
    /// Whether @a few others or more are nearer than @a far to the i-th of points(), and one is
    /// nearer than @a close. @a far is a cell's side at most.
    bool hasNeighbors(std::size_t i, int few, double far, double close) const;

    /// Look about a point of the cell. @param far  a cell's side at most; what is looked about is
    /// a few spacings, too.
    void lookAbout(std::uint32_t point, double far);
    /// Look twice as far. @return false if that is too far.
    bool lookFarther();
    /// How many other points are nearer than completeTo().
    std::size_t count() const { return mAbout.size(); }
    /// The k-th of them, nearest first.
    const Near& near(std::size_t k) const
    {
        if (k >= mSorted) sortBeyond(k);
        return mAbout[k];
    }
    double distance(std::size_t k) const { return std::sqrt(double(near(k).squared)); }
    double completeTo() const { return mRadius; }
    bool isWithinCells() const { return mRadius < mCells.side(); }

private:
    /// What is counted until it is enough.
    struct Count {
        int far = 0, close = 0;
        bool isEnough(int few) const { return far >= few && close > 0; }
    };
    Count countInCell(std::size_t i, int few, float far, float close) const;
    void lookTo(double radius);
    void sortBeyond(std::size_t k) const;

    const std::vector<Vec3f>& mPositions;
    const PointCells& mCells;
    const PointIndex& mIndex;
    const std::vector<char>& mFlags;
    std::vector<const PointCells::Cell*> mAround; // cells around it
    double mSpacing = 0;
    std::vector<std::uint32_t> mPoints;
    std::vector<float> mX, mY, mZ; // of mPoints
    Vec3f mMiddle = Vec3f::Zero(); // what is looked about
    std::uint32_t mMiddlePoint = 0;
    double mRadius = 0;
    mutable std::vector<Near> mAbout;
    mutable std::size_t mSorted = 0; ///< of mAbout: the nearest
};

} // namespace mpuvdb
