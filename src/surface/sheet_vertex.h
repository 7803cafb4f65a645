// Where the vertex of a sheet lies in its cell.
#pragma once
#include "dual_cells.h"

#include <mpuvdb/field.h>

namespace mpuvdb
{

/// A vertex in voxels from the block's origin.
struct SheetVertex {
    Vec3f position;
    bool feature = false; ///< on a crease or corner of the surface
    float reach = 0;      ///< how far from the mean of its crossings
};

/// How far a vertex on a crease may go to lie on it.
enum class Freedom : std::uint8_t {
    Near, ///< half a voxel out of its cell
    Cell, ///< not out of its cell
    Half, ///< halfway there from the mean of the crossings
    None  ///< not at all: the mean of the crossings, away from the walls of the cell
};

/// Places the vertices of one block after the other, from the values around and, where there is
/// one, the field that the values were sampled from. For one thread.
class SheetPlacer
{
public:
    /// @param field  null: none; has to outlive this. @param lattice  of the values.
    SheetPlacer(const Field* field, const Lattice& lattice)
        : mField(field ? field->evaluator(lattice.voxelSize) : nullptr), mLattice(lattice)
    {
    }

    void load(const openvdb::FloatTree& tree, const openvdb::Coord& origin)
    {
        mValues.load(tree, origin);
        mOrigin = Vec3d(origin.x(), origin.y(), origin.z());
        ++mBlock;
    }
    /// The vertex of sheet @a sheet of the cell at @a at, each in [0,7].
    SheetVertex place(const Vec3i& at, const DualCell& cell, int sheet, Freedom freedom);

private:
    struct Crossings;
    class Planes;
    /// Where the values, linear between voxels, cross an edge, and the gradient there.
    struct ValueCrossing {
        Vec3f normal;            ///< unit
        float at;                ///< along the edge, 0 to 1
        bool isSteep;            ///< as steep as a distance
        std::uint32_t block = 0; ///< for which it was found
    };
    /// A plane through a voxel's nearest place on the surface, as the values on one side of the
    /// voxel tell it.
    struct Plane {
        Vec3f normal = Vec3f::Zero();
        float distance = 0;      ///< of the voxel, signed, voxels, or a multiple of it:
        float steepness = 1;     ///< of the values
        float error = 0;         ///< of what it predicts there
        std::uint32_t block = 0; ///< for which it was found
    };
    struct FieldCrossing {
        Vec3f normal;
        float at;                ///< along the edge, 0 to 1
        bool isFound;            ///< field and values agree that there is one
        std::uint32_t block = 0; ///< for which it was looked for
    };

    static constexpr std::size_t kVoxels = 9 * 9 * 9;
    /// Of a voxel of the block or one beyond, each in [0,8].
    static std::size_t voxelIndex(const Vec3i& voxel)
    {
        const auto x = std::size_t(voxel.x()), y = std::size_t(voxel.y());
        return (x * 9 + y) * 9 + std::size_t(voxel.z());
    }
    static std::size_t edgeIndex(const Vec3i& low, int axis)
    {
        return 3 * voxelIndex(low) + std::size_t(axis);
    }
    Crossings crossingsOf(const Vec3i& at, const DualCell& cell, int sheet);
    const ValueCrossing& valueCrossing(const Vec3i& low, int axis);
    Vec3f centralGradient(int index) const;
    Plane planeThrough(int index) const;
    const Plane& planeAt(const Vec3i& voxel);
    void addGridPlanes(const Vec3i& at, const Crossings& crossings, Planes& planes);
    const FieldCrossing& fieldCrossing(const Vec3i& at, int edge, float start);
    void addFieldPlanes(const Vec3i& at, const Crossings& crossings, Planes& planes);
    bool isStraight(int index, float most) const;
    bool liesOnFold(const Vec3i& at, const Crossings& crossings);
    Vec3f ontoSurface(const Vec3i& at, Vec3f inCell) const;

    std::unique_ptr<PointEvaluator> mField; ///< null: none
    Lattice mLattice;
    BlockHalo mValues;
    Vec3d mOrigin = Vec3d::Zero(); ///< of the block, voxels
    /// @{ What cells have in common with those beside them, found for the first that asks: by
    /// voxel, or by axis and the voxel at the edge's low end.
    std::uint32_t mBlock = 0; ///< number of the block, from 1 on
    std::vector<ValueCrossing> mValueCrossings = std::vector<ValueCrossing>(3 * kVoxels);
    std::vector<FieldCrossing> mFieldCrossings; ///< empty until one is asked for
    std::vector<Plane> mPlanes;                 ///< empty until one is asked for
    /// @}
};

} // namespace mpuvdb
