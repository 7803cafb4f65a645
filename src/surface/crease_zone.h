// The patches beside creases, and the values that they were made from.
#pragma once
#include "grid/voxel_index.h"
#include "surface_patches.h"

#include <algorithm>

namespace mpuvdb
{

/// The voxels' patches of a level set, by place, and which of them are beside a crease: not smooth,
/// or next to one that is not.
class CreaseZone
{
public:
    /// @param scale  1 / voxel size. @throws Interrupted.
    CreaseZone(const SurfacePatches& patches, const openvdb::FloatTree& tree, float scale,
               Values values, Interrupter& progress);

    const SurfacePatches& patches() const { return mPatches; }
    const VoxelIndex& index() const { return mIndex; }
    bool isBeside(std::uint32_t patch) const { return mBeside[patch]; }
    /// Of the patches [from, to).
    std::size_t countBeside(std::uint32_t from, std::uint32_t to) const
    {
        return std::size_t(std::count(mBeside.begin() + from, mBeside.begin() + to, true));
    }
    /// Let the patches [from, to) be beside no crease.
    void leaveOut(std::uint32_t from, std::uint32_t to)
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

    /// In voxels, if they are distances.
    float at(const openvdb::Coord& voxel) const { return mZone.mScale * mAccess.getValue(voxel); }
    bool crosses(const openvdb::Coord& a, const openvdb::Coord& b) const
    {
        return (mAccess.getValue(a) < 0) != (mAccess.getValue(b) < 0);
    }
    /// How much the values rise per voxel about @a voxel, at most; 1 for distances.
    float slopeAt(const openvdb::Coord& voxel) const;

    /// By central differences.
    Vec3f gradientAt(const openvdb::Coord& voxel) const;

private:
    const CreaseZone& mZone;
    openvdb::tree::ValueAccessor<const openvdb::FloatTree> mAccess;
};

} // namespace mpuvdb
