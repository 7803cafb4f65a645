#include "surroundings.h"

#include "spatial/position_order.h"

#include <algorithm>

namespace mpuvdb
{

void Surroundings::enter(const PointCells::Cell& cell)
{
    mAround.clear();
    mCells.forEachAround(cell, [&](std::uint32_t c) { mAround.push_back(&mCells.cells()[c]); });
    // Of the cells in which the points are, the mean over these: few points beside many count
    // little. A surface that crosses a cell has about the area of its face.
    double points = cell.size(), squares = points * points;
    for (const PointCells::Cell* c : mAround) {
        points += c->size();
        squares += double(c->size()) * c->size();
    }
    mSpacing = mCells.side() * std::sqrt(points / squares);
    mPoints.clear();
    mX.clear();
    mY.clear();
    mZ.clear();
    const Coordinates positions = mIndex.positions();
    mCells.forEachPoint(cell, [&](std::uint32_t n) {
        const std::uint32_t p = mIndex.order()[n];
        if (mFlags[p]) return;
        mPoints.push_back(p);
        mX.push_back(positions.x[n]);
        mY.push_back(positions.y[n]);
        mZ.push_back(positions.z[n]);
    });
}

Surroundings::Count Surroundings::countInCell(std::size_t i, int few, float far, float close) const
{
    constexpr std::size_t kChunk = 32; // counted without a branch; [free: as many are enough]
    const float x = mX[i], y = mY[i], z = mZ[i];
    const std::size_t chunks = (mPoints.size() + kChunk - 1) / kChunk;
    Count count{-1, -1}; // it is found itself
    for (std::size_t n = 0; n < chunks && !count.isEnough(few); ++n) {
        // From its own place on: the points of a cell are in Morton order.
        const std::size_t begin = (i / kChunk + n) % chunks * kChunk;
        const std::size_t end = std::min(begin + kChunk, mPoints.size());
        for (std::size_t k = begin; k < end; ++k) {
            const float dx = mX[k] - x, dy = mY[k] - y, dz = mZ[k] - z;
            const float squared = dx * dx + dy * dy + dz * dz;
            count.far += squared < far ? 1 : 0;
            count.close += squared < close ? 1 : 0;
        }
    }
    return count;
}

bool Surroundings::hasNeighbors(std::size_t i, int few, double far, double close) const
{
    const auto squaredFar = float(far * far), squaredClose = float(close * close);
    Count count = countInCell(i, few, squaredFar, squaredClose);
    if (count.isEnough(few)) return true;
    const Vec3f p(mX[i], mY[i], mZ[i]);
    for (const PointCells::Cell* cell : mAround) {
        mCells.forEachPoint(*cell, [&](std::uint32_t n) {
            const float squared = (mIndex[n] - p).squaredNorm();
            if (squared >= squaredFar && squared >= squaredClose) return;
            if (mFlags[mIndex.order()[n]]) return;
            count.far += squared < squaredFar;
            count.close += squared < squaredClose;
        });
        if (count.isEnough(few)) return true;
    }
    return false;
}

void Surroundings::lookAbout(std::uint32_t point, double far)
{
    // Spacings. [free: where more is asked for it is looked farther; fifty points of a surface are
    // within]
    constexpr double kSpacings = 4;
    mMiddlePoint = point;
    mMiddle = mPositions[point];
    mRadius = 0;
    mAbout.clear();
    mSorted = 0;
    lookTo(std::max(far, std::min(kSpacings * mSpacing, mCells.side())));
}

bool Surroundings::lookFarther()
{
    // Sides of a cell. [derived: two spacings of what is 16 times sparser]
    constexpr double kMostSides = 8;
    const double farthest = kMostSides * mCells.side();
    if (mRadius >= farthest) return false;
    // Nothing is gained within the cells that are at hand.
    lookTo(std::min(2 * mRadius, mRadius < mCells.side() ? mCells.side() : farthest));
    return true;
}

void Surroundings::lookTo(double radius)
{
    constexpr double kRounded = 1 + 1e-6; // [derived: what rounding to floats may make nearer]
    const auto within = float(mRadius * mRadius), squaredRadius = float(radius * radius);
    const auto take = [&](std::uint32_t begin, std::uint32_t end) {
        for (std::uint32_t n = begin; n < end; ++n) {
            const float squared = (mIndex[n] - mMiddle).squaredNorm();
            if (!(squared < squaredRadius) || squared < within) continue;
            const std::uint32_t q = mIndex.order()[n];
            if (q != mMiddlePoint && !mFlags[q]) mAbout.push_back({squared, q});
        }
    };
    mIndex.forEachRunNear(mMiddle, kRounded * radius, take);
    mRadius = radius;
}

void Surroundings::sortBeyond(std::size_t k) const
{
    constexpr std::size_t kFew = 16; // [free: the same order]
    const auto before = [&](const Near& a, const Near& b) {
        return a.squared != b.squared ? a.squared < b.squared
                                      : positionBefore(mPositions[a.point], mPositions[b.point]);
    };
    const auto begin = mAbout.begin() + std::ptrdiff_t(mSorted);
    mSorted = std::min(mAbout.size(), 2 * k + kFew);
    const auto end = mAbout.begin() + std::ptrdiff_t(mSorted);
    if (end != mAbout.end()) std::nth_element(begin, end, mAbout.end(), before);
    std::sort(begin, end, before);
}

} // namespace mpuvdb
