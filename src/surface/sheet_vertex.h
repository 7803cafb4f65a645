// Placement of a sheet's vertex in its cell.
#pragma once
#include "dual_cells.h"
#include "octant_plane.h"
#include <mpuvdb/field.h>

namespace mpuvdb
{

/// A vertex in voxels from the block's origin.
struct SheetVertex {
    Vec3f position;
    bool feature = false; ///< on a crease or corner of the surface
    float reach = 0;      ///< distance from the mean of its crossings, voxels
};

/// Limit of a crease vertex's displacement.
enum class Freedom : std::uint8_t {
    Near, ///< up to half a voxel outside its cell
    Cell, ///< within its cell
    Half, ///< halfway from the mean of the crossings
    None  ///< none: the mean of the crossings, inset from the walls of the cell
};

/// Places the vertices of one block after the other, from the values and, if given, the field that
/// they were sampled from. For one thread.
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
        // Not registered with the tree: cheap to make.
        mValues.load(openvdb::tree::ValueAccessor<const openvdb::FloatTree, false>(tree), origin,
                     1);
        mOrigin = Vec3d(origin.x(), origin.y(), origin.z());
        ++mBlock;
    }
    /// The vertex of sheet @a sheet of the cell at @a at, each in [0,7].
    SheetVertex place(const Vec3i& at, const DualCell& cell, int sheet, Freedom freedom);

private:
    struct Crossings;
    class Planes;
    /// The crossing of an edge by values that are linear between voxels, and the gradient there.
    struct ValueCrossing {
        Vec3f normal;            ///< unit
        float at;                ///< along the edge, 0 to 1
        bool isSteep;            ///< the slope is that of a distance
        std::uint32_t block = 0; ///< for which it was found
    };
    struct Plane {
        OctantPlane plane;
        std::uint32_t block = 0; ///< for which it was found
    };
    struct FieldCrossing {
        Vec3f normal;
        float at;                ///< along the edge, 0 to 1
        bool isFound;            ///< field and values agree that there is one
        std::uint32_t block = 0; ///< for which it was looked for
    };

    /// Voxels of the block and the layers above. [derived: (8 + 1)^3]
    static constexpr std::size_t kVoxels = 9 * 9 * 9;
    /// Index of a voxel of the block or the layers above, each coordinate in [0,8].
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
    const OctantPlane& planeAt(const Vec3i& voxel);
    void addGridPlanes(const Vec3i& at, const Crossings& crossings, Planes& planes);
    const FieldCrossing& fieldCrossing(const Vec3i& at, int edge, float start);
    void addFieldPlanes(const Vec3i& at, const Crossings& crossings, Planes& planes);
    bool isOffField(const Vec3i& at, const Vec3f& inCell) const;
    float curvatureAt(int index) const;
    bool isCurved(const Vec3i& at, const Crossings& crossings);
    bool liesOnFold(const Vec3i& at, const Crossings& crossings);
    template <int kAxis>
    std::array<float, 4> rowThrough(int home, const Vec3f& inCell) const;
    Vec3f ontoSurface(const Vec3i& at, Vec3f inCell) const;

    std::unique_ptr<PointEvaluator> mField; ///< null: none
    Lattice mLattice;
    BlockHalo mValues;
    Vec3d mOrigin = Vec3d::Zero(); ///< of the block, voxels
    /// @{ Caches shared by neighboring cells: by voxel, or by axis and the voxel at the edge's low
    /// end.
    std::uint32_t mBlock = 0; ///< number of the block, from 1 on
    std::vector<ValueCrossing> mValueCrossings = std::vector<ValueCrossing>(3 * kVoxels);
    std::vector<FieldCrossing> mFieldCrossings; ///< empty before the first use
    std::vector<Plane> mPlanes;                 ///< empty before the first use
    /// @}
};

} // namespace mpuvdb
