// Points to level set in one call, with defaults that the data choose.
#pragma once
#include <mpuvdb/length.h>
#include <mpuvdb/mpu_field.h>
#include <mpuvdb/point_cloud.h>
#include <mpuvdb/sampling.h>

#include <array>
#include <memory>
#include <optional>

namespace mpuvdb
{

/// What the user asked for; everything left empty is derived from the data.
struct ReconstructSettings {
    std::optional<PointStatistics> points; ///< of the cloud, if known; default: measured
    std::optional<Length> voxelSize;       ///< default: the measured spacing of the points
    std::optional<double> voxels;    ///< instead of voxelSize: along the longest side of the box
    std::optional<Length> tolerance; ///< default: from voxel size and measured noise
    double halfWidth = 3;            ///< voxels
    std::optional<double> alpha;     ///< support radius / cell diagonal; default: 0.75, or 1.25
    std::optional<int> minPoints;    ///< default: 15
    bool sharp = true;               ///< no matter where points are interpolated
    bool interpolate = false;        ///< zero at every point, for points that are exact
    std::uint64_t maxBytes = 0;      ///< memory the work may take; 0: no limit
    /// x0 y0 z0 x1 y1 z1 of a box: only what is in it is sampled, see SampleSettings::region. All
    /// points are fitted; voxel size and tolerance are those of the whole.
    std::optional<std::array<Length, 6>> region;
};

/// What the settings came to, in world units.
struct ResolvedSettings {
    PointStatistics points;
    Vec3d boxSize = Vec3d::Zero();
    double diagonal = 0;
    MpuSettings fit;
    SampleSettings grid;
};

/// A level set with what was learned on the way.
struct Reconstruction {
    LevelSet levelSet;
    std::shared_ptr<const MpuField> field;
    ResolvedSettings settings;
};

/// What a reconstruction would take and come to.
struct ReconstructionEstimate {
    ResolvedSettings settings;
    MpuEstimate fit;
    double area = 0; ///< of the surface, world units squared
    std::uint64_t activeVoxels = 0;
    std::uint64_t gridBytes = 0; ///< held by the level set
    std::uint64_t peakBytes = 0; ///< the most that reconstruct() takes, the cloud included
};

/// Derive what the user left open. @throws UsageError, InputError, LimitError (index range).
ResolvedSettings resolve(const PointCloud& cloud, const ReconstructSettings& settings,
                         Interrupter* interrupter = nullptr);

/// Estimate what reconstruct() would take, without it: a part of the points is fitted as it would
/// fit them, and a surface with larger voxels through every so many points tells the area, filled
/// holes and all. Takes as long as reconstructing a hundred thousand points or so. Peak memory
/// comes out to a fifth. In short: 56 bytes a point while they are sorted; then 36 a point, about
/// 70 a leaf of the octree (twice that while it is built), and 18 an active voxel.
/// @throws as reconstruct().
ReconstructionEstimate estimate(const PointCloud& cloud, const ReconstructSettings& settings,
                                Interrupter* interrupter = nullptr);

/// Fit and sample. @a cloud has outward normals and is consumed.
Reconstruction reconstruct(PointCloud&& cloud, const ReconstructSettings& settings,
                           Interrupter* interrupter = nullptr);

} // namespace mpuvdb
