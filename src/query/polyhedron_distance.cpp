#include "polyhedron_distance.h"

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

/// Error of values, voxels, up to which they are a polyhedron's distances. [derived: the hundredth
/// of a voxel that answers about edges may be off, docs/limits.md]
constexpr double kExact = 1e-2;
/// Second difference of values, voxels, up to which they are a plane's. [derived: at a block's
/// other end, 14 voxels away, the plane is off by a thousandth of a voxel]
constexpr double kFlat = 1e-5;
/// Error of a gradient's squared length up to which it is a distance's. [derived: angles below
/// 1e-3, 14 voxels away, are a hundredth of a voxel]
constexpr double kSteep = 1e-3;
/// Squared sine of the angle of two planes below which they count as one where they meet. [derived:
/// five voxels from there the distance is off by less than kExact / 100]
constexpr double kParallel = 1e-6;

} // namespace

PolyhedronDistance::PolyhedronDistance(const openvdb::FloatTree& tree, double voxelSize)
    : mAccessor(tree), mVoxelSize(voxelSize),
      mBackground(float(double(tree.background()) / voxelSize))
{
}

void PolyhedronDistance::load(const openvdb::Coord& origin)
{
    mValues.load(mAccessor, origin, float(1 / mVoxelSize));
    mExplained = {};
    mPlanes.clear();
    findPlanes();
    if (mPlanes.empty() || mPlanes.size() > kMostPlanes) return;
    findMeets();
    const Corners inBand = cornersInBand();
    Cells touched{};
    for (std::size_t x = 0; x < kBlockDim; ++x)
        for (std::size_t y = 0; y < kBlockDim; ++y)
            touched[x][y] = std::uint8_t(cellsAt(inBand, x, y));
    mSide = 1;
    mExplained = explainedCells(touched);
    if (mExplained == touched) return;
    const auto turn = [this] {
        mSide = -mSide;
        for (Plane& plane : mPlanes) plane = {-plane.normal, -plane.offset};
    };
    turn();
    const Cells concave = explainedCells(touched);
    const auto count = [](const Cells& cells) {
        int sum = 0;
        for (const auto& rows : cells)
            for (const unsigned row : rows) sum += __builtin_popcount(row);
        return sum;
    };
    if (count(concave) > count(mExplained))
        mExplained = concave;
    else
        turn();
}

void PolyhedronDistance::findPlanes()
{
    for (int x = 1 - kMargin; x < kBlockDim + kMargin - 1; ++x)
        for (int y = 1 - kMargin; y < kBlockDim + kMargin - 1; ++y)
            for (int z = 1 - kMargin; z < kBlockDim + kMargin - 1; ++z) {
                addPlaneAt(x, y, z);
                if (mPlanes.size() > kMostPlanes) return;
            }
}

/// Adds the plane to which the values about a voxel are distances, if there is one that is new.
void PolyhedronDistance::addPlaneAt(int x, int y, int z)
{
    const int at = mValues.index(x, y, z);
    const auto value = double(mValues[at]);
    if (!isInBand(mValues[at])) return;
    const Vec3d place(x, y, z);
    for (const Plane& plane : mPlanes)
        if (std::abs(plane.height(place) - value) < kExact) return;
    Vec3d gradient;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const float above = mValues[at + mValues.kStride[axis]];
        const float below = mValues[at - mValues.kStride[axis]];
        if (!isInBand(above) || !isInBand(below)) return;
        if (std::abs(double(above) + double(below) - 2 * value) > kFlat) return;
        gradient[Eigen::Index(axis)] = (double(above) - double(below)) / 2;
    }
    if (std::abs(gradient.squaredNorm() - 1) > kSteep) return;
    const Vec3d normal = gradient.normalized();
    mPlanes.push_back({normal, normal.dot(place) - value});
}

void PolyhedronDistance::findMeets()
{
    mMeets.clear();
    for (std::size_t a = 0; a < mPlanes.size(); ++a)
        for (std::size_t b = 0; b < a; ++b) {
            addMeet({b, a, 0}, 2);
            for (std::size_t c = 0; c < b; ++c) addMeet({c, b, a}, 3);
        }
}

void PolyhedronDistance::addMeet(std::array<std::size_t, 3> planes, std::size_t count)
{
    Eigen::Matrix3d products = Eigen::Matrix3d::Identity();
    for (std::size_t i = 0; i < count; ++i)
        for (std::size_t j = 0; j < count; ++j)
            products(Eigen::Index(i), Eigen::Index(j)) =
                mPlanes[planes[i]].normal.dot(mPlanes[planes[j]].normal);
    if (products.determinant() < kParallel) return; // two are parallel, or all three to one line
    mMeets.push_back({planes, count, products.inverse()});
}

PolyhedronDistance::Corners PolyhedronDistance::cornersInBand() const
{
    Corners corners{};
    for (int x = 0; x < kCorners; ++x)
        for (int y = 0; y < kCorners; ++y)
            for (int z = 0; z < kCorners; ++z)
                corners[std::size_t(x)][std::size_t(y)] |=
                    unsigned(isInBand(mValues[mValues.index(x, y, z)])) << z;
    return corners;
}

/// Bits of the cells of row (x,y) that have one of @a corners.
unsigned PolyhedronDistance::cellsAt(const Corners& corners, std::size_t x, std::size_t y)
{
    const unsigned row =
        corners[x][y] | corners[x][y + 1] | corners[x + 1][y] | corners[x + 1][y + 1];
    return row | row >> 1;
}

/// Those of @a cells all of whose corners have the distance to the polyhedron.
PolyhedronDistance::Cells PolyhedronDistance::explainedCells(const Cells& cells) const
{
    Corners asked{}, against{};
    for (std::size_t x = 0; x < kBlockDim; ++x)
        for (std::size_t y = 0; y < kBlockDim; ++y)
            for (std::size_t n = 0; n < 4; ++n)
                asked[x + n / 2][y + n % 2] |= unsigned(cells[x][y]) | unsigned(cells[x][y]) << 1;
    for (std::size_t x = 0; x < kCorners; ++x)
        for (std::size_t y = 0; y < kCorners; ++y)
            for (unsigned left = asked[x][y]; left; left &= left - 1) {
                const int z = __builtin_ctz(left);
                against[x][y] |= unsigned(!explainsVoxel(int(x), int(y), z)) << z;
            }
    Cells explained{};
    for (std::size_t x = 0; x < kBlockDim; ++x)
        for (std::size_t y = 0; y < kBlockDim; ++y)
            explained[x][y] = std::uint8_t(cells[x][y] & ~cellsAt(against, x, y));
    return explained;
}

/// Whether a voxel's value in the band is the distance to the polyhedron, or a voxel beyond the
/// band is no less than a voxel within it.
bool PolyhedronDistance::explainsVoxel(int x, int y, int z) const
{
    Vec3d gradient;
    const double found = distance(Vec3d(x, y, z), gradient);
    const float value = mValues[mValues.index(x, y, z)];
    return isInBand(value) ? std::abs(found - double(value)) < kExact
                           : std::copysign(1, double(value)) * found > double(mBackground) - 1;
}

/// The way to the nearest place of a convex polyhedron is the longest of those to the planes'
/// faces, edges and corners that are sums of their normals with positive weights: the dual of a
/// quadratic program.
double PolyhedronDistance::distance(const Vec3d& place, Vec3d& gradient) const
{
    std::array<double, kMostPlanes> heights{};
    std::size_t highest = 0;
    for (std::size_t n = 0; n < mPlanes.size(); ++n) {
        heights[n] = mPlanes[n].height(place);
        if (heights[n] > heights[highest]) highest = n;
    }
    gradient = mSide * mPlanes[highest].normal;
    if (heights[highest] <= 0) return mSide * heights[highest];
    double farthest = heights[highest] * heights[highest]; // squared
    const Meet* nearest = nullptr;
    Vec3d nearestWeights = Vec3d::Zero();
    for (const Meet& meet : mMeets) {
        Vec3d above = Vec3d::Zero();
        for (std::size_t i = 0; i < meet.count; ++i)
            above[Eigen::Index(i)] = heights[meet.planes[i]];
        const Vec3d weights = meet.inverse * above;
        const double squared = weights.dot(above);
        if ((weights.array() < 0).any() || squared <= farthest) continue;
        farthest = squared;
        nearest = &meet;
        nearestWeights = weights;
    }
    const double length = std::sqrt(farthest);
    if (nearest) {
        gradient.setZero();
        for (std::size_t i = 0; i < nearest->count; ++i)
            gradient += nearestWeights[Eigen::Index(i)] * mPlanes[nearest->planes[i]].normal;
        gradient *= mSide / length;
    }
    return mSide * length;
}

double PolyhedronDistance::value(const Vec3d& place, Vec3d& gradient) const
{
    return mVoxelSize * distance(place, gradient);
}

} // namespace mpuvdb
