// The distance to a polyhedron about a block of voxels, from its planes.
#pragma once
#include "grid/leaf_halo.h"

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace mpuvdb
{

/// The distance to a solid that about a block of 8x8x8 cells is convex and bounded by a few planes,
/// or whose complement is. Beside creases, where interpolation is no distance, it is exact. For one
/// thread.
class PolyhedronDistance
{
public:
    using Accessor = openvdb::tree::ValueAccessor<const openvdb::FloatTree, false>;

    /// @param voxelSize  world units.
    PolyhedronDistance(const openvdb::FloatTree& tree, double voxelSize);

    /// Finds the planes by the values in and about the block at @a origin, a multiple of 8 voxels.
    void load(const openvdb::Coord& origin);
    /// Whether the cell at (x,y,z) of the block has a corner in the band, and the values at its
    /// corners are distances to what the planes bound.
    bool explains(int x, int y, int z) const
    {
        return mExplained[std::size_t(x)][std::size_t(y)] >> z & 1;
    }
    /// The signed distance, world units, of @a place in such a cell, voxels from the block's
    /// origin. @param gradient  becomes that of the distance, unit.
    double value(const Vec3d& place, Vec3d& gradient) const;

private:
    /// Most planes about a block. [derived: the corner of a plate that is thinner than a block]
    static constexpr std::size_t kMostPlanes = 4;
    /// Voxels around the block that planes are looked for in. [derived: a place's nearest face is
    /// up to three voxels away in the default band, and from its corner on it takes three more
    /// until a voxel and its neighbors are nearest to that face]
    static constexpr int kMargin = 6;
    /// Bit z of row (x,y) is that of the cell at (x,y,z).
    using Cells = std::array<std::array<std::uint8_t, kBlockDim>, kBlockDim>;

    /// Corners of cells along an axis. [derived: one more than cells]
    static constexpr int kCorners = kBlockDim + 1;
    /// Bit z of row (x,y) is that of the corner at (x,y,z).
    using Corners = std::array<std::array<unsigned, kCorners>, kCorners>;

    struct Plane {
        Vec3d normal;  ///< unit, out of the convex side
        double offset; ///< along it, voxels from the block's origin

        double height(const Vec3d& place) const { return normal.dot(place) - offset; }
    };
    /// Planes that meet in an edge or a corner.
    struct Meet {
        std::array<std::size_t, 3> planes{};
        std::size_t count = 0;
        Eigen::Matrix3d inverse; ///< of the normals' products
    };

    bool isInBand(float value) const { return std::abs(value) < mBackground; }
    void findPlanes();
    void addPlaneAt(int x, int y, int z);
    void findMeets();
    void addMeet(std::array<std::size_t, 3> planes, std::size_t count);
    Corners cornersInBand() const;
    static unsigned cellsAt(const Corners& corners, std::size_t x, std::size_t y);
    Cells explainedCells(const Cells& cells) const;
    bool explainsVoxel(int x, int y, int z) const;
    double distance(const Vec3d& place, Vec3d& gradient) const;

    Accessor mAccessor;
    double mVoxelSize;
    float mBackground;                     ///< voxels
    BlockWindow<kMargin, kMargin> mValues; ///< voxels
    std::vector<Plane> mPlanes;
    std::vector<Meet> mMeets;
    double mSide = 1; ///< -1 if the complement is convex
    Cells mExplained{};
};

} // namespace mpuvdb
