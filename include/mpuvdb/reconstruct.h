// The door: points to a level set in one call, with defaults that the data choose.
//
// reconstruct() is what the command and Python call, too. Where more than one level set is wanted
// of the same points, or a look at what it will take, its three steps stand alone: preparePoints(),
// fitPoints(), sampleFit().
#pragma once
#include <mpuvdb/clean.h>
#include <mpuvdb/explained.h>
#include <mpuvdb/length.h>
#include <mpuvdb/mpu_field.h>
#include <mpuvdb/point_input.h>
#include <mpuvdb/sampling.h>

#include <array>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace mpuvdb
{

/// What is asked for; everything left empty is derived from the data.
struct ReconstructOptions {
    /// Of points in memory: what happens to those that cannot be used.
    BadPoints badPoints = BadPoints::Drop;
    /// What is done to the points before the fit; empty: nothing, they have outward normals.
    std::optional<CleanSettings> clean = CleanSettings{};

    std::optional<Length> voxelSize; ///< default: the measured spacing of the points
    std::optional<double> voxels;    ///< instead of voxelSize: along the longest side of the box
    std::optional<Length> tolerance; ///< default: from voxel size and measured noise
    double halfWidth = 3;            ///< voxels, in [1.5, 1000]
    std::optional<double> alpha;     ///< support radius / cell diagonal; default: 0.75, or 1.25
    std::optional<int> minPoints;    ///< default: 15
    bool sharp = true;               ///< no matter where points are interpolated
    bool interpolate = false;        ///< zero at every point, for points that are exact
    /// x0 y0 z0 x1 y1 z1 of a box: only what is in it is sampled, see SampleSettings::region. All
    /// points are fitted; voxel size and tolerance are those of the whole.
    std::optional<std::array<Length, 6>> region;

    bool coverage = false; ///< a grid that says where data support the surface
    /// Grids beside it, see MpuField::attributes(): kColorName, "confidence", scalars by name.
    std::vector<std::string> attributes;

    /// Bytes that the work may take; default: no limit. It is estimated before it is taken.
    std::optional<std::uint64_t> maxBytes;
};

/// What the options came to, in world units.
struct ResolvedSettings {
    PointStatistics points;
    Vec3d boxSize = Vec3d::Zero();
    double diagonal = 0;
    MpuSettings fit;
    SampleSettings grid;
};

/// What was found on the way.
struct ReconstructReport {
    std::uint64_t points = 0;                     ///< that are fitted
    std::map<std::string, std::uint64_t> dropped; ///< points left out, by reason
    CleanReport cleaned;
    ResolvedSettings settings;
    MpuStatistics fit;
    PointsExplained explained;             ///< the level set, held against the points
    std::optional<double> coverageSpacing; ///< world units: the points' as coverage measures it
    std::vector<std::string> notes;        ///< what a user should know
    std::vector<std::string> warnings;     ///< what a user has to know
};

/// Points on their way to the fit.
struct PreparedPoints {
    PointCloud cloud;
    ReconstructOptions options;
    ReconstructReport report;
};

/// Clean the points, measure them, and derive what the options leave open.
/// @throws UsageError, InputError (too few points, a mesh whose vertices do not show its surface),
/// LimitError (index range), Interrupted.
PreparedPoints preparePoints(PointInput&& points, const ReconstructOptions& options = {},
                             Interrupter* interrupter = nullptr);

/// Points that are a field.
struct FittedPoints {
    std::shared_ptr<const MpuField> field;
    ReconstructOptions options;
    ReconstructReport report;
};

/// Fit the points. @throws InputError, Interrupted.
FittedPoints fitPoints(PreparedPoints&& points, Interrupter* interrupter = nullptr);

/// A level set, what belongs to it, and what was learned on the way.
struct ReconstructResult {
    openvdb::FloatGrid::Ptr grid;     ///< the level set; the caller's, nobody else holds it
    openvdb::FloatGrid::Ptr coverage; ///< null unless asked for
    std::vector<openvdb::GridBase::Ptr> attributes; ///< grids as sampleAttributes() makes them
    std::shared_ptr<const MpuField> field;
    ReconstructReport report;

    /// The grid as what operations take; it shares the tree, which must not change any more.
    LevelSet levelSet() const;
};

/// Sample the field, and hold the level set against its points. @throws as sampleField().
ReconstructResult sampleFit(const FittedPoints& fitted, Interrupter* interrupter = nullptr);

/// What was measured and what the settings came to, as metadata of a written grid: names
/// ("mpuvdb:tolerance") to texts, with the library's version.
std::map<std::string, std::string> metadataOf(const ReconstructReport& report);

/// Points in memory to a level set. Equal points in one order and equal options give equal bytes,
/// for any number of threads.
/// @throws UsageError (options out of range, attributes of another number than the points),
/// InputError (nothing to use), LimitError (maxBytes, index range), Interrupted.
ReconstructResult reconstruct(const PointView& points, const ReconstructOptions& options = {},
                              Interrupter* interrupter = nullptr);
/// The same of points that were read (readPoints()), or of a cloud.
ReconstructResult reconstruct(PointInput&& points, const ReconstructOptions& options = {},
                              Interrupter* interrupter = nullptr);

/// What a reconstruction would take and come to.
struct ReconstructionEstimate {
    ResolvedSettings settings;
    MpuEstimate fit;
    double area = 0;                ///< of the surface, world units squared
    std::uint64_t activeVoxels = 0; ///< of the level set
    std::uint64_t gridBytes = 0;    ///< held by the level set
    std::uint64_t bandBytes = 0;    ///< while it is sampled, beside the field
    std::uint64_t fileBytes =
        0; ///< of a .vdb file with level set and coverage, if that is asked for
    std::uint64_t triangles = 0; ///< of a mesh of it
    std::uint64_t peakBytes = 0; ///< the most that the work takes, the points included
    /// @{ Of processor time, seconds, as this machine has just done a part: to half or twice.
    double fitSeconds = 0, sampleSeconds = 0;
    /// @}
};

/// Estimate what the rest of reconstruct() would take, without it: a part of the points is fitted
/// as it would fit them, and a surface with larger voxels through every so many points tells the
/// area, filled holes and all. Takes as long as reconstructing a hundred thousand points or so.
/// Peak memory comes out to a fifth. In short: 56 bytes a point while they are sorted; then 36 a
/// point, about 70 a leaf of the octree (twice that while it is built), and 18 an active voxel.
/// @param withMesh  whether a mesh is extracted at the end. @throws as reconstruct().
ReconstructionEstimate estimate(const PreparedPoints& points, bool withMesh = false,
                                Interrupter* interrupter = nullptr);

/// The estimate of work that would take more than options.maxBytes; empty if they are, or it takes
/// no more. Work that is far from them is not estimated.
/// @param heldBytes  what the process holds beside the points and counts, too. @throws as
/// estimate().
std::optional<ReconstructionEstimate> beyondMemory(const PreparedPoints& points, bool withMesh,
                                                   std::uint64_t heldBytes,
                                                   Interrupter* interrupter = nullptr);

/// @throws LimitError for work beyondMemory(), with the voxel size that would do; as estimate().
void requireMemory(const PreparedPoints& points, bool withMesh, std::uint64_t heldBytes,
                   Interrupter* interrupter = nullptr);

} // namespace mpuvdb
