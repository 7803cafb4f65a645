// Narrow-band level sets in OpenVDB grids: made from fields, and checked.
//
// Conventions: negative inside; values are world units; the half-width is in voxels (3 by
// default); voxels are uniform; the background is half-width x voxel size; inactive values are
// +background outside and -background inside; the grid is called "surface" and has class
// GRID_LEVEL_SET.
#pragma once
#include <mpuvdb/fields.h>

#include <openvdb/openvdb.h>

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace mpuvdb
{

class Interrupter;
struct Explained;

/// An immutable narrow-band level set.
class LevelSet
{
public:
    /// @throws InputError unless @a grid has uniform voxels along the axes, the class level set and
    /// a positive background.
    explicit LevelSet(openvdb::FloatGrid::ConstPtr grid);
    /// The same, with its comparison with the points or the mesh that it was made from.
    LevelSet(openvdb::FloatGrid::ConstPtr grid, std::shared_ptr<const Explained> explained);

    const openvdb::FloatGrid& grid() const { return *mGrid; }
    openvdb::FloatGrid::ConstPtr gridPtr() const { return mGrid; }
    /// Edge of a voxel, world units.
    double voxelSize() const;
    /// Background, voxels.
    double halfWidth() const;
    Lattice lattice() const;
    /// Box of the centers of the active voxels, world units; empty without any.
    Box3d bounds() const;
    /// The comparison with the input that it was made from (explained.h); null for results of
    /// operations and level sets from files.
    const std::shared_ptr<const Explained>& explained() const { return mExplained; }

private:
    openvdb::FloatGrid::ConstPtr mGrid;
    std::shared_ptr<const Explained> mExplained;
};

/// @throws InputError if a value of @a grid is not finite.
void requireFinite(const openvdb::FloatGrid& grid);

/// The empty level set: outside everywhere. @param halfWidth  voxels, in [1.5, 1000].
/// @throws UsageError and LimitError for the voxel size, as latticeFor(), and for the half-width.
LevelSet emptyLevelSet(const Lattice& lattice, double halfWidth,
                       const std::string& name = "surface");

/// The lattice for voxels of @a voxelSize (world units) about @a bounds: aligned to the world's
/// multiples of the voxel size, so that grids of one voxel size combine without resampling. Beyond
/// 2^20 voxels from the origin it is translated by a multiple of 8 voxels, which keeps indices
/// small.
/// @throws UsageError unless 0 < @a voxelSize < infinity, LimitError below 1.5e-5, InputError for
/// bounds that are empty or not finite, LimitError where doubles or indices do not resolve voxels.
Lattice latticeFor(const Box3d& bounds, double voxelSize);

/// @a levelSet as a field: cubic interpolation of its values [Catmull74], exact at its voxels.
/// Beyond the band only the sign is meaningful.
FieldPtr makeGridField(const LevelSet& levelSet);

/// One fault of a grid.
struct CheckFinding {
    std::string what;        ///< description with numbers
    openvdb::Coord voxel;    ///< the worst voxel; of equals the first by (x,y,z)
    std::uint64_t count = 0; ///< number of voxels; 0: the grid as a whole
};

/// Largest mean ||grad| - 1| of distances, dimensionless. [tuned: level_set_test]
constexpr double kGradientTolerance = 0.1;

/// The result of check(). The grid is sound if findings is empty.
struct CheckReport {
    std::uint64_t activeVoxels = 0;
    double meanGradientError = 0; ///< mean of ||grad| - 1| where the stencil is in the band
    double maxGradientError = 0;
    double bandInside = 0, bandOutside = 0; ///< largest distance of an active voxel, in voxels
    std::vector<CheckFinding> findings;
    bool sound() const { return findings.empty(); }
};

/// Check that @a grid is a sound narrow-band level set: the class level set, uniform voxels along
/// the axes, a background of at least one voxel, finite values, |value| <= background where active
/// and = background elsewhere, a complete band on both sides (a voxel l voxels from one of distance
/// d is active if d + l is less than the half-width by half a voxel), steps of at most two voxels
/// between active neighbors, a mean ||grad| - 1| over n voxels of at most @a gradientTolerance +
/// 0.5 / sqrt(n), no change of sign between neighbors of which one is inactive. An empty level set
/// is sound. The report does not depend on the number of threads.
/// @param gradientTolerance  dimensionless, above 0.
/// @param within  only leaves and tiles that lie in it with the voxels around them are checked, as
/// for a region whose band ends at its border.
/// @throws Interrupted.
CheckReport check(const openvdb::FloatGrid& grid, double gradientTolerance = kGradientTolerance,
                  const openvdb::CoordBBox& within = openvdb::CoordBBox::inf(),
                  Interrupter* interrupter = nullptr);

} // namespace mpuvdb
