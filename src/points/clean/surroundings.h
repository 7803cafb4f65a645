// The points about those of a cell, as far as one has to look.
#pragma once
#include "spatial/cell_grid.h"

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

    Surroundings(const std::vector<Vec3f>& positions, const CellGrid& grid,
                 const std::vector<char>& flags)
        : mPositions(positions), mGrid(grid), mFlags(flags)
    {
    }

    void enter(const CellGrid::Cell& cell);
    /// The cell's points.
    const std::vector<std::uint32_t>& points() const { return mPoints; }
    /// The spacing of the points in the cell and around it, where they are most.
    double spacing() const { return mSpacing; }
    /// Whether @a few others or more are nearer than @a far to the i-th of points(), and one is
    /// nearer than @a close. @a far is a cell's side at most.
    bool hasCompany(std::size_t i, int few, double far, double close) const;

    /// Look about a point of the cell. @param far  a cell's side at most; what is looked about is
    /// a few spacings, too.
    void lookAbout(std::uint32_t point, double far);
    /// Look twice as far. @return false if that is too far.
    bool lookFarther();
    /// All other points nearer than completeTo(), nearest first.
    const std::vector<Near>& about() const { return mAbout; }
    double distance(std::size_t k) const { return std::sqrt(double(mAbout[k].squared)); }
    double completeTo() const { return mRadius; }
    bool isWithinCells() const { return mRadius < mGrid.side(); }

private:
    /// What is counted until it is enough.
    struct Company {
        int far = 0, close = 0;
        bool isEnough(int few) const { return far >= few && close > 0; }
    };
    Company companyInCell(std::size_t i, int few, float far, float close) const;
    void gather();
    void take(const CellGrid::Cell& cell);

    const std::vector<Vec3f>& mPositions;
    const CellGrid& mGrid;
    const std::vector<char>& mFlags;
    const CellGrid::Cell* mCell = nullptr;
    std::vector<const CellGrid::Cell*> mAround; // cells around it
    double mSpacing = 0;
    std::vector<std::uint32_t> mPoints;
    std::vector<float> mX, mY, mZ; // of mPoints
    Vec3f mMiddle = Vec3f::Zero(); // what is looked about
    std::uint32_t mMiddlePoint = 0;
    double mRadius = 0;
    std::vector<Near> mAbout;
};

} // namespace mpuvdb
