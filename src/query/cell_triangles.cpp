#include "cell_triangles.h"

#include "core/clones.h"
#include "core/lanes.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

namespace mpuvdb
{
namespace
{

using Lanes = float __attribute__((vector_size(32)));

/// Distance from a cube's middle to its corners, sizes. [derived: sqrt(3) / 2, and roundings]
constexpr double kHalfDiagonal = 0.8661;
/// Share by which squared distances of floats err, and by which those of a size are off. [derived:
/// some 40 roundings of numbers up to a few sizes]
constexpr float kFloats = 1e-5f;

} // namespace

CellTriangles::CellTriangles(const TriangleTree& tree, double size) : mTree(tree), mSize(size) {}

void CellTriangles::Group::set(std::size_t lane, const std::array<Vec3d, 3>& corners)
{
    for (std::size_t k = 0; k < 3; ++k) {
        const Vec3d along = corners[(k + 1) % 3] - corners[k];
        const double square = along.squaredNorm();
        inverse[k][lane] = square > 0 ? float(1 / square) : 0;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            corner[k][axis][lane] = float(corners[k][Eigen::Index(axis)]);
            edge[k][axis][lane] = float(along[Eigen::Index(axis)]);
        }
    }
    const Vec3d area = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    const Vec3d unit = area.squaredNorm() > 0 ? area.normalized() : Vec3d::Zero();
    for (std::size_t axis = 0; axis < 3; ++axis)
        normal[axis][lane] = float(unit[Eigen::Index(axis)]);
}

void CellTriangles::gather(const Vec3d& middle)
{
    mMiddle = middle;
    const double nearest = std::sqrt(mTree.squaredDistance(middle, mSlot));
    // Of a place in the cube, the nearest triangle is at most half a diagonal farther than that of
    // the middle, which is at most as much farther from it.
    const double reach = nearest + 2 * kHalfDiagonal * mSize;
    mNear.clear();
    mTree.forEachLeafNear(middle, reach, [&](std::size_t leaf) {
        const double distance2 = mTree.squaredBoundOfLeaf(leaf, middle);
        if (distance2 <= reach * reach) mNear.push_back({distance2, std::uint32_t(leaf)});
    });
    std::sort(mNear.begin(), mNear.end(), [](const Near& a, const Near& b) {
        return a.distance2 < b.distance2 || (a.distance2 == b.distance2 && a.leaf < b.leaf);
    });
    mCount = (mNear.size() + kGroupLeaves - 1) / kGroupLeaves;
    mMade = 0;
    if (mGroups.size() < mCount) {
        mGroups.resize(mCount);
        mDistances.resize(mCount);
    }
}

void CellTriangles::makeNext()
{
    Group& group = mGroups[mMade];
    std::size_t lane = 0;
    const std::size_t begin = mMade * kGroupLeaves;
    for (std::size_t n = begin; n < std::min(begin + kGroupLeaves, mNear.size()); ++n)
        for (std::size_t slot = mTree.firstSlot(mNear[n].leaf);
             slot < mTree.firstSlot(mNear[n].leaf + 1); ++slot)
            group.slots[lane++] = std::uint32_t(slot);
    // Lanes beyond the last triangle repeat it.
    for (; lane < kLanes; ++lane) group.slots[lane] = group.slots[lane - 1];
    for (lane = 0; lane < kLanes; ++lane) {
        std::array<Vec3d, 3> corners;
        for (std::size_t k = 0; k < 3; ++k)
            corners[k] = (mTree.corners(group.slots[lane])[k].cast<double>() - mMiddle) / mSize;
        group.set(lane, corners);
    }
    ++mMade;
}

/// The least of the distances to the three edges, and to the plane where the foot is within them.
MPUVDB_CLONES
void CellTriangles::squaredDistances(const Group& group, const Vec3f& p, Numbers& distances)
{
    const auto vectorsAt = [](const Vectors& from) {
        return std::array<Lanes, 3>{lanesAt<Lanes>(from[0].data()), lanesAt<Lanes>(from[1].data()),
                                    lanesAt<Lanes>(from[2].data())};
    };
    const std::array<Lanes, 3> normal = vectorsAt(group.normal);
    Lanes left = Lanes{} + 1, least = Lanes{} + std::numeric_limits<float>::max();
    std::array<Lanes, 3> from{};
    for (std::size_t k = 0; k < 3; ++k) {
        const std::array<Lanes, 3> along = vectorsAt(group.edge[k]);
        from = vectorsAt(group.corner[k]);
        for (std::size_t axis = 0; axis < 3; ++axis)
            from[axis] = p[Eigen::Index(axis)] - from[axis];
        Lanes t = lanesAt<Lanes>(group.inverse[k].data()) *
                  (along[0] * from[0] + along[1] * from[1] + along[2] * from[2]);
        t = t > 0 ? t : Lanes{};
        t = t < 1 ? t : Lanes{} + 1;
        const Lanes x = from[0] - t * along[0], y = from[1] - t * along[1];
        const Lanes z = from[2] - t * along[2];
        const Lanes square = x * x + y * y + z * z;
        least = square < least ? square : least;
        const Lanes side = normal[0] * (along[1] * from[2] - along[2] * from[1]) +
                           normal[1] * (along[2] * from[0] - along[0] * from[2]) +
                           normal[2] * (along[0] * from[1] - along[1] * from[0]);
        left = side > 0 ? left : Lanes{};
    }
    const Lanes height = normal[0] * from[0] + normal[1] * from[1] + normal[2] * from[2];
    const Lanes found = left > 0 ? height * height : least;
    std::memcpy(distances.data(), &found, sizeof found);
}

double CellTriangles::squaredDistance(const Vec3d& p, std::size_t& slot)
{
    const Vec3d at = (p - mMiddle) / mSize;
    const auto off = float(at.norm());
    const Vec3f place = at.cast<float>();
    float least = HUGE_VALF, root = HUGE_VALF;
    std::size_t count = 0;
    for (; count < mCount; ++count) {
        const auto nearest = float(std::sqrt(mNear[count * kGroupLeaves].distance2) / mSize);
        if (nearest - off > root * (1 + kFloats) + kFloats) break;
        if (count == mMade) makeNext();
        squaredDistances(mGroups[count], place, mDistances[count]);
        for (std::size_t lane = 0; lane < kLanes; ++lane)
            least = std::min(least, mDistances[count][lane]);
        root = std::sqrt(least);
    }
    const float most = least * (1 + kFloats) + kFloats;
    double best = HUGE_VAL;
    for (std::size_t g = 0; g < count; ++g)
        for (std::uint64_t bits = bitsOf(lanesAt<Lanes>(mDistances[g].data()) <= most); bits;
             bits &= bits - 1) {
            const std::size_t s = mGroups[g].slots[std::size_t(__builtin_ctzll(bits))];
            const double distance2 = mTree.squaredDistanceTo(s, p);
            if (!(distance2 < best || (distance2 == best && s < slot))) continue;
            best = distance2;
            slot = s;
        }
    return best;
}

} // namespace mpuvdb
