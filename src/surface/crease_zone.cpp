#include "crease_zone.h"

#include "joined_faces.h"
#include <mpuvdb/interrupter.h>

namespace mpuvdb
{

using openvdb::Coord;

CreaseZone::CreaseZone(const SurfacePatches& patches, const openvdb::FloatTree& tree, float scale,
                       Values values, Interrupter& progress)
    : mPatches(patches), mTree(tree), mScale(scale), mValues(values),
      mBeside(patches.patches.size())
{
    /// Items between two looks at the interrupter. [free: response time]
    constexpr std::size_t kCheckInterval = 1 << 14;
    for (std::size_t n = 0; n < patches.patches.size(); ++n) {
        if (n % kCheckInterval == 0) progress.check();
        mIndex.add(patches.patches[n].voxel);
    }
    mIndex.number();
    VoxelNumbers numbers(mIndex);
    for (std::size_t n = 0; n < patches.kinds.size(); ++n) {
        if (n % kCheckInterval == 0) progress.check();
        if (patches.kinds[n] == PatchKind::Smooth) continue;
        for (int k = 0; k < 27; ++k) {
            const std::uint32_t near =
                numbers[patches.patches[n].voxel.offsetBy(k / 9 - 1, k / 3 % 3 - 1, k % 3 - 1)];
            if (near != VoxelIndex::kNone) mBeside[near] = true;
        }
    }
}

float CreaseValues::slopeAt(const Coord& voxel) const
{
    if (mZone.mValues == Values::Distances) return 1;
    const float here = at(voxel);
    float square = 0;
    for (int axis = 0; axis < 3; ++axis) {
        Coord low = voxel, high = voxel;
        low[axis] -= 1;
        high[axis] += 1;
        const float rise = std::max(std::abs(at(low) - here), std::abs(at(high) - here));
        square += rise * rise;
    }
    return std::sqrt(square);
}

const CellSheets& CreaseValues::sheetsOf(const Coord& cell) const
{
    const JoinedFaces faces(mAccess, 1 / mZone.mScale);
    const std::uint8_t inside = faces.cornersAt(cell);
    return cellSheets(inside, faces.of(cell, inside));
}

Vec3f CreaseValues::gradientAt(const Coord& voxel) const
{
    Vec3f gradient;
    for (int axis = 0; axis < 3; ++axis) {
        Coord low = voxel, high = voxel;
        low[axis] -= 1;
        high[axis] += 1;
        gradient[axis] = 0.5f * (at(high) - at(low));
    }
    return gradient;
}

} // namespace mpuvdb
