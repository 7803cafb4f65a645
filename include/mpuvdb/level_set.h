// Narrow-band level sets in OpenVDB grids: made from fields, and checked.
//
// Conventions: negative inside; values are world units; the half-width is in voxels (3 unless
// told); voxels are uniform; the background is half-width x voxel size; inactive values are
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
    /// The same, made of points or of a mesh and held against them.
    LevelSet(openvdb::FloatGrid::ConstPtr grid, std::shared_ptr<const Explained> explained);

    const openvdb::FloatGrid& grid() const { return *mGrid; }
    openvdb::FloatGrid::ConstPtr gridPtr() const { return mGrid; }
    double voxelSize() const;
    /// Background in voxels.
    double halfWidth() const;
    Lattice lattice() const;
    /// The centers of the active voxels, world units; empty without any.
    Box3d bounds() const;
    /// How it compares with what it was made of (explained.h); null for what operations make, and
    /// for what comes from files.
    const std::shared_ptr<const Explained>& explained() const { return mExplained; }

private:
    openvdb::FloatGrid::ConstPtr mGrid;
    std::shared_ptr<const Explained> mExplained;
};

/// @throws InputError if a value of @a grid is not finite: operations would carry it on, or take it
/// for outside.
void demandFinite(const openvdb::FloatGrid& grid);

/// The level set of nothing: outside everywhere. @param halfWidth  voxels.
LevelSet emptyLevelSet(const Lattice& lattice, double halfWidth);

/// The lattice for voxels of @a voxelSize about @a bounds: aligned to the world's multiples of the
/// voxel size, so that grids of one voxel size combine without resampling; from 2^20 voxels away
/// from the origin on, the transform's translation keeps indices small.
/// @throws UsageError unless 0 < @a voxelSize < infinity, LimitError below 1.5e-5, InputError for
/// bounds that are empty or not finite, LimitError where doubles or indices cannot tell the voxels
/// apart.
Lattice latticeFor(const Box3d& bounds, double voxelSize);

/// @a levelSet as a field: cubic interpolation of its values, exact at its voxels; deep inside and
/// outside only the sign counts.
FieldPtr makeGridField(const LevelSet& levelSet);

/// One thing that is wrong with a grid.
struct CheckFinding {
    std::string what;        ///< what is wrong, with the numbers
    openvdb::Coord voxel;    ///< where it is worst; of equals the first by (x,y,z)
    std::uint64_t count = 0; ///< of voxels; 0: the grid as a whole
};

/// The largest mean ||grad| - 1| of what counts as a distance.
constexpr double kGradientTolerance = 0.1;

/// What check() measured. Sound if findings is empty.
struct CheckReport {
    std::uint64_t activeVoxels = 0;
    double meanGradientError = 0; ///< mean of ||grad| - 1| where the stencil is in the band
    double maxGradientError = 0;
    double bandInside = 0, bandOutside = 0; ///< largest distance of an active voxel, in voxels
    std::vector<CheckFinding> findings;
    bool sound() const { return findings.empty(); }
};

/// Check a grid of any origin against what a level set promises: class, uniform voxels along the
/// axes, a background of at least one voxel, finite values, |value| <= background where active and
/// = background elsewhere, a complete band on both sides (a voxel l voxels from one of distance d
/// is active if d + l is less than the half-width by half a voxel), steps of at most two voxels
/// between active neighbors, a mean ||grad| - 1| over n voxels of at most @a gradientTolerance and
/// 0.5 / sqrt(n), no change of sign between neighbors of which one is inactive. An empty level set
/// is sound. The report does not depend on the number of threads. @param within  judged are only
/// leaves and tiles that lie in it with the voxels around them: of a region, which ends somewhere.
/// @throws Interrupted.
CheckReport check(const openvdb::FloatGrid& grid, double gradientTolerance = kGradientTolerance,
                  const openvdb::CoordBBox& within = openvdb::CoordBBox::inf(),
                  Interrupter* interrupter = nullptr);

} // namespace mpuvdb
