#include "surroundings.h"

#include "spatial/position_order.h"

#include <algorithm>

namespace mpuvdb
{

void Surroundings::enter(const CellGrid::Cell& cell)
{
    mCell = &cell;
    mAround.clear();
    mGrid.forEachAround(cell, [&](std::uint32_t c) { mAround.push_back(&mGrid.cells()[c]); });
    // Of the cells in which the points are, the mean over these: few points beside many count
    // little. A surface that crosses a cell has about the area of its face.
    double points = cell.size(), squares = points * points;
    for (const CellGrid::Cell* c : mAround) {
        points += c->size();
        squares += double(c->size()) * c->size();
    }
    mSpacing = mGrid.side() * std::sqrt(points / squares);
    mPoints.clear();
    mX.clear();
    mY.clear();
    mZ.clear();
    for (std::uint32_t k = cell.begin; k < cell.end; ++k) {
        const std::uint32_t p = mGrid.order()[k];
        if (mFlags[p]) continue;
        const Vec3f& position = mGrid.positions()[k];
        mPoints.push_back(p);
        mX.push_back(position.x());
        mY.push_back(position.y());
        mZ.push_back(position.z());
    }
}

Surroundings::Company Surroundings::companyInCell(std::size_t i, int few, float far,
                                                  float close) const
{
    constexpr std::size_t kChunk = 32; // counted without a branch
    const float x = mX[i], y = mY[i], z = mZ[i];
    const std::size_t chunks = (mPoints.size() + kChunk - 1) / kChunk;
    Company company{-1, -1}; // it is found itself
    for (std::size_t n = 0; n < chunks && !company.isEnough(few); ++n) {
        // From its own place on: the points of a cell are sorted.
        const std::size_t begin = (i / kChunk + n) % chunks * kChunk;
        const std::size_t end = std::min(begin + kChunk, mPoints.size());
        for (std::size_t k = begin; k < end; ++k) {
            const float dx = mX[k] - x, dy = mY[k] - y, dz = mZ[k] - z;
            const float squared = dx * dx + dy * dy + dz * dz;
            company.far += squared < far ? 1 : 0;
            company.close += squared < close ? 1 : 0;
        }
    }
    return company;
}

bool Surroundings::hasCompany(std::size_t i, int few, double far, double close) const
{
    const auto squaredFar = float(far * far), squaredClose = float(close * close);
    Company company = companyInCell(i, few, squaredFar, squaredClose);
    if (company.isEnough(few)) return true;
    const Vec3f p(mX[i], mY[i], mZ[i]);
    for (const CellGrid::Cell* cell : mAround)
        for (std::uint32_t k = cell->begin; k < cell->end; ++k) {
            const float squared = (mGrid.positions()[k] - p).squaredNorm();
            if (squared >= squaredFar && squared >= squaredClose) continue;
            if (mFlags[mGrid.order()[k]]) continue;
            company.far += squared < squaredFar;
            company.close += squared < squaredClose;
            if (company.isEnough(few)) return true;
        }
    return false;
}

void Surroundings::lookAbout(std::uint32_t point, double far)
{
    constexpr double kSpacings = 4; // within which are fifty points of a surface
    mMiddlePoint = point;
    mMiddle = mPositions[point];
    mRadius = std::max(far, std::min(kSpacings * mSpacing, mGrid.side()));
    gather();
}

bool Surroundings::lookFarther()
{
    constexpr double kMostSides = 8; // two spacings of what is 16 times sparser
    const double farthest = kMostSides * mGrid.side();
    if (mRadius >= farthest) return false;
    // Nothing is gained within the cells that are at hand.
    mRadius = std::min(2 * mRadius, mRadius < mGrid.side() ? mGrid.side() : farthest);
    gather();
    return true;
}

void Surroundings::gather()
{
    mAbout.clear();
    take(*mCell);
    for (const CellGrid::Cell* cell : mAround) take(*cell);
    const int rings = int(std::ceil(mRadius / mGrid.side()));
    for (int ring = 2; ring <= rings; ++ring)
        mGrid.forEachOfRing(*mCell, ring, [&](std::uint32_t c) { take(mGrid.cells()[c]); });
    std::sort(mAbout.begin(), mAbout.end(), [&](const Near& a, const Near& b) {
        return a.squared != b.squared ? a.squared < b.squared
                                      : positionBefore(mPositions[a.point], mPositions[b.point]);
    });
}

void Surroundings::take(const CellGrid::Cell& cell)
{
    const auto squaredRadius = float(mRadius * mRadius);
    const auto radius = float(mRadius);
    const Vec3f* const positions = mGrid.positions().data();
    // The points of a cell are sorted by x.
    const Vec3f* const from =
        std::partition_point(positions + cell.begin, positions + cell.end,
                             [&](const Vec3f& q) { return q.x() < mMiddle.x() - radius; });
    for (auto k = std::size_t(from - positions);
         k < cell.end && positions[k].x() <= mMiddle.x() + radius; ++k) {
        const float squared = (positions[k] - mMiddle).squaredNorm();
        const std::uint32_t q = mGrid.order()[k];
        if (squared < squaredRadius && q != mMiddlePoint && !mFlags[q])
            mAbout.push_back({squared, q});
    }
}

} // namespace mpuvdb
