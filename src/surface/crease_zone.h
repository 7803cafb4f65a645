// The patches beside creases, and the values from which they were made.
#pragma once
#include "cell_sheets.h"
#include "grid/voxel_index.h"
#include "octant_plane.h"
#include "sign_halo.h"
#include "surface_patch.h"

#include <algorithm>

namespace mpuvdb
{

/// The patches of a level set's voxels, by voxel, with a flag for those beside a crease: not
/// smooth, or 26-neighbors of one that is not.
class CreaseZone
{
public:
    /// @param scale  1 / voxel size. @throws Interrupted.
    CreaseZone(const SurfacePatches& patches, const openvdb::FloatTree& tree, float scale,
               Values values, Interrupter& progress);

    const SurfacePatches& patches() const { return mPatches; }
    const VoxelIndex& index() const { return mIndex; }
    bool isBeside(std::uint32_t patch) const { return mBeside[patch]; }
    /// Count of the patches in [from, to) beside a crease.
    std::size_t countBeside(std::uint32_t from, std::uint32_t to) const
    {
        return std::size_t(std::count(mBeside.begin() + from, mBeside.begin() + to, true));
    }
    /// Remove the patches in [from, to) from the zone.
    void exclude(std::uint32_t from, std::uint32_t to)
    {
        std::fill(mBeside.begin() + from, mBeside.begin() + to, false);
    }

private:
    friend class CreaseValues;
    const SurfacePatches& mPatches;
    const openvdb::FloatTree& mTree;
    float mScale;
    Values mValues;
    VoxelIndex mIndex;         ///< numbers are those of the patches
    std::vector<char> mBeside; ///< by patch
};

/// Reads a zone's values. For one thread.
class CreaseValues
{
public:
    explicit CreaseValues(const CreaseZone& zone) : mZone(zone), mAccess(zone.mTree) {}

    /// The value of @a voxel; in voxels, if values are distances.
    float at(const openvdb::Coord& voxel) const { return mZone.mScale * mAccess.getValue(voxel); }
    bool crosses(const openvdb::Coord& a, const openvdb::Coord& b) const
    {
        return (mAccess.getValue(a) < 0) != (mAccess.getValue(b) < 0);
    }
    /// Largest slope of the values about @a voxel, per voxel; 1 for distances.
    float slopeAt(const openvdb::Coord& voxel) const;

    /// The sheets of the surface in a cell, by its lowest corner.
    const CellSheets& sheetsOf(const openvdb::Coord& cell) const;

    /// The plane by the values about @a voxel.
    OctantPlane planeAt(const openvdb::Coord& voxel) const
    {
        return octantPlaneAt(mAccess, voxel, mZone.mScale);
    }

    /// Gradient by central differences, per voxel.
    Vec3f gradientAt(const openvdb::Coord& voxel) const;

private:
    const CreaseZone& mZone;
    SignHalo::Access mAccess;
};

} // namespace mpuvdb
