#include "solid_sums.h"

#include "core/clones.h"

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

using Tree = openvdb::FloatTree;
using Leaf = Tree::LeafNodeType;
using Neighbors = openvdb::tree::ValueAccessor<const Tree, /*IsSafe=*/false>;

/// Voxels with a face neighbor of the other sign in the leaf.
SignWords crossedWithin(const SignWords& inside)
{
    SignWords crossed{};
    for (std::size_t x = 0; x < inside.size(); ++x) {
        const std::uint64_t in = inside[x];
        const std::uint64_t alongY = (in ^ in >> 8) & ~0ull >> 8, alongZ = (in ^ in >> 1) & ~kLastZ;
        crossed[x] |= alongY | alongY << 8 | alongZ | alongZ << 1;
        if (x + 1 == inside.size()) break;
        const std::uint64_t alongX = in ^ inside[x + 1];
        crossed[x] |= alongX;
        crossed[x + 1] |= alongX;
    }
    return crossed;
}

/// Whether a face neighbor of a voxel beyond the leaf has the other sign.
bool isCrossedBeyond(const Neighbors& at, const openvdb::Coord& voxel, bool inside)
{
    for (int axis = 0; axis < 3; ++axis) {
        const int along = voxel[axis] & int(Leaf::DIM - 1);
        if (along != 0 && along != int(Leaf::DIM - 1)) continue;
        openvdb::Coord next = voxel;
        next[axis] += along ? 1 : -1;
        if ((at.getValue(next) < 0) != inside) return true;
    }
    return false;
}

/// Sums over a leaf's voxels as if a plane passed each at its distance: of the inside share of a
/// slab a voxel wide, and of the area in a tent two voxels wide. In voxels.
MPUVDB_WIDE_CLONES
SolidSums sumPlanes(const float* values, float perVoxel)
{
    constexpr std::size_t kLanes =
        8; ///< independent sums, for vector units [derived: a leaf's row]
    float volume[kLanes] = {}, area[kLanes] = {};
    for (std::size_t n = 0; n < std::size_t(kBlockVoxels); n += kLanes)
        for (std::size_t k = 0; k < kLanes; ++k) {
            const float distance = perVoxel * values[n + k];
            volume[k] += std::min(std::max(0.5f - distance, 0.0f), 1.0f);
            area[k] += std::max(1 - std::abs(distance), 0.0f);
        }
    SolidSums sums;
    for (std::size_t k = 0; k < kLanes; ++k) {
        sums.volume += double(volume[k]);
        sums.area += double(area[k]);
    }
    return sums;
}

} // namespace

SolidSums sumLeaf(const Leaf& leaf, const SignWords& inside, const Tree& tree, float voxelSize)
{
    const float* const values = leaf.buffer().data();
    SolidSums sums = sumPlanes(values, 1 / voxelSize);
    if (sums.area == 0) return sums; // no voxel is a half from the surface either
    const SignWords crossed = crossedWithin(inside);
    const float half = 0.5f * voxelSize;
    const SignWords near = wordsWhere(values, [=](float value) { return std::abs(value) < half; });
    const Neighbors at(tree);
    for (std::size_t x = 0; x < inside.size(); ++x)
        for (std::uint64_t rest = near[x] & ~crossed[x]; rest; rest &= rest - 1) {
            const auto bit = std::size_t(__builtin_ctzll(rest));
            const bool isInside = inside[x] >> bit & 1u;
            const auto offset = openvdb::Index(64 * x + bit);
            if (isCrossedBeyond(at, leaf.offsetToGlobalCoord(offset), isInside)) continue;
            const double distance = double(values[offset]) / double(voxelSize);
            sums.volume += double(isInside) - (0.5 - distance);
        }
    return sums;
}

} // namespace mpuvdb
