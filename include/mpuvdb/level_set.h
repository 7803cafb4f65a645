// Narrow-band level sets in OpenVDB grids: made from fields, and checked.
//
// Conventions: negative inside; values are world units; the half-width is in voxels (3 unless
// told); voxels are uniform; the background is half-width x voxel size; inactive values are
// +background outside and -background inside; the grid is called "surface" and has class
// GRID_LEVEL_SET.
#pragma once
#include <mpuvdb/field.h>

#include <openvdb/openvdb.h>

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace mpuvdb
{

class Progress;
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

/// How a field becomes a grid.
struct SampleSettings {
    Lattice lattice;
    double halfWidth = 3; ///< voxels, in [1.5, 100]
    std::string name = "surface";
    std::uint64_t maxBytes = 0; ///< memory the grid may take; 0: no limit
    bool mayBeEmpty = false;    ///< without a zero crossing: an empty level set, and no InputError
    /// Only the voxels with their centers in this box (world units) are sampled, and a margin of
    /// kRegionMargin voxels around it that is dropped at the end. Active in the result are exactly
    /// those that are active in the box without it, with the same values; everything outside the
    /// box is inactive, and counts as outside. That holds where nothing that the steps after
    /// sampling take for a flaw reaches from the box beyond the margin: an island or a handle they
    /// remove, a jump of the field they close; or where the whole is so noisy that all distances
    /// are made anew. A region without a surface is an empty level set. The cost is that of the
    /// region, but for what the field itself does.
    std::optional<Box3d> region;
};

/// Voxels around a region that are looked at.
constexpr int kRegionMargin = 32;

/// The voxels with their centers in @a region.
openvdb::CoordBBox voxelsIn(const Box3d& region, const Lattice& lattice);

/// The level set of nothing: outside everywhere. @param halfWidth  voxels.
LevelSet emptyLevelSet(const Lattice& lattice, double halfWidth);

/// The lattice for voxels of @a voxelSize about @a bounds: aligned to the world's multiples of the
/// voxel size, so that grids of one voxel size combine without resampling; from 2^20 voxels away
/// from the origin on, the transform's translation keeps indices small.
/// @throws UsageError unless 0 < @a voxelSize < infinity, LimitError below 1.5e-5, InputError for
/// bounds that are empty or not finite, LimitError where doubles or indices cannot tell the voxels
/// apart.
Lattice latticeFor(const Box3d& bounds, double voxelSize);

/// Sample @a field into a narrow band: searched from its seeds by continuation, closed so that no
/// sign change lies between inactive voxels, inactive space signed.
/// @throws LimitError (memory, index range), InputError if there is no zero crossing, Interrupted.
LevelSet sampleField(const Field& field, const SampleSettings& settings, Progress& progress);

/// Name of the grid that says where data support the surface beside it.
constexpr const char* kCoverageName = "coverage";

/// What @a coverage says of the zero set of @a levelSet, on the active voxels of its band: each has
/// the value of the nearest place on the zero set (value times gradient away from it). Same
/// transform; class unknown, for it is neither a distance nor a density; inactive voxels 0; called
/// kCoverageName, with metadata that say what it is and the data's spacing. The same for any number
/// of threads. @throws Interrupted.
openvdb::FloatGrid::Ptr sampleCoverage(const LevelSet& levelSet, const Coverage& coverage,
                                       Progress& progress);

/// The data's spacing as sampleCoverage() noted it in @a coverage, or the size of its voxels if
/// that is more (or nothing is noted): world units.
double coverageScale(const openvdb::FloatGrid& coverage);

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
CheckReport check(const openvdb::FloatGrid& grid, Progress& progress,
                  double gradientTolerance = kGradientTolerance,
                  const openvdb::CoordBBox& within = openvdb::CoordBBox::inf());

} // namespace mpuvdb
