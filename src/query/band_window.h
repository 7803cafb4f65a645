// The values of a block of voxels with those around it, and the distance at places in it by cubic
// interpolation, where that is one.
#pragma once
#include "core/clones.h"
#include <mpuvdb/field.h>

#include <array>
#include <cstdint>
#include <openvdb/openvdb.h>

namespace mpuvdb
{

/// A block of 8x8x8 cells of a level set, whose lower corners are the block's voxels. For one
/// thread.
///
/// Cubic interpolation [Catmull74] needs the 64 voxels about a cell. Where the band ends, those
/// that miss are extrapolated by parabolas along the axes. It is the distance where the values are
/// smooth, and not where a ridge or a crease of the distance passes: there third differences of
/// neighboring values are large. Beside a cell that such a crease misses, the voxels across it are
/// left out, and parabolas take the cubic's place [Harten87].
class BandWindow
{
public:
    using Leaf = openvdb::FloatTree::LeafNodeType;
    using Accessor = openvdb::tree::ValueAccessor<const openvdb::FloatTree, false>;

    /// @param voxelSize  world units.
    BandWindow(const openvdb::FloatTree& tree, double voxelSize);

    /// Loads the block at @a origin, a multiple of 8 voxels.
    void load(const openvdb::Coord& origin);
    const openvdb::Coord& origin() const { return mOrigin; }

    /// Whether the values about the cell at (x,y,z) of the block are smooth.
    bool isSmooth(int x, int y, int z) const { return isIn(mSmooth, x, y, z); }
    /// Whether interpolation is a distance in the cell at (x,y,z).
    bool canInterpolate(int x, int y, int z) const { return isIn(mUsable, x, y, z); }
    /// The value, world units, at @a place, voxels from the block's origin, in [0, 8), in a cell
    /// where it canInterpolate().
    float value(const Vec3f& place) const;
    /// The same with its gradient, dimensionless.
    float value(const Vec3f& place, Vec3f& gradient) const;

private:
    /// Voxels kept below and above the block: those that third differences across the cells beside
    /// its border need. [derived: of four voxels]
    static constexpr int kBelow = 2, kAbove = 3;
    static constexpr int kEdge = kBelow + kBlockDim + kAbove; ///< voxels [derived: sum]
    /// Floats of a row along z. [derived: two registers of eight]
    static constexpr int kRow = 16;
    /// Steps to the next voxel along x, y, z. [derived: kEdge, kRow]
    static constexpr std::array<int, 3> kSteps = {kEdge * kRow, kRow, 1};
    /// Bit z of row (x,y) is that of the voxel at (x,y,z).
    using Bits = std::array<std::array<std::uint16_t, kEdge>, kEdge>;

    /// Bit z of row (x,y) is that of the cell at (x,y,z).
    using Cells = std::array<std::array<std::uint8_t, kBlockDim>, kBlockDim>;

    static bool isIn(const Cells& cells, int x, int y, int z)
    {
        return cells[std::size_t(x)][std::size_t(y)] >> z & 1;
    }
    static std::size_t index(int x, int y, int z)
    {
        return (std::size_t(x) * kEdge + std::size_t(y)) * kRow + std::size_t(z);
    }
    void loadLeaf(const openvdb::Coord& side);
    void extrapolate();
    MPUVDB_CLONES bool extrapolateRows(const Bits& known);
    static Cells wholeCells(const Bits& voxels);
    static Cells touchedCells(const Bits& voxels);
    MPUVDB_CLONES bool findRough(const Bits& known, std::array<Bits, 3>& rough) const;
    void findSides(const std::array<Bits, 3>& rough);
    bool isWhole(const Bits& voxels, int x, int y, int z) const;
    unsigned roughBits(int x, int y, int axis, unsigned from) const;
    /// Along an axis, the side of a cell on which a crease passes: -1 the lower, 1 the upper, else
    /// 0.
    int side(std::size_t axis, int x, int y, int z) const
    {
        return mIsSmooth ? 0 : int(isIn(mAbove[axis], x, y, z)) - int(isIn(mBelow[axis], x, y, z));
    }

    Accessor mAccessor;
    float mVoxelSize;
    openvdb::Coord mOrigin;
    alignas(64) std::array<float, kEdge * kEdge * kRow + kRow> mValues{}; ///< all finite
    Bits mKnown{};         ///< in the band, or extrapolated
    Bits mTorn{};          ///< extrapolated, perhaps across a crease
    Cells mUsable{};       ///< cells where interpolation is a distance
    Cells mSmooth{};       ///< those of them where no crease passes beside them
    bool mIsSmooth = true; ///< all of them are
    /// By axis, cells beside which a crease passes on the lower and the upper side.
    std::array<Cells, 3> mBelow{}, mAbove{};
};

} // namespace mpuvdb
