// Level sets from fields, meshes and grids of any class; and coverage of their surfaces.
#pragma once
#include <mpuvdb/level_set.h>
#include <mpuvdb/triangle_mesh.h>

#include <cstdint>
#include <limits>
#include <optional>
#include <string>

namespace mpuvdb
{

class Interrupter;

/// Settings of sampling.
struct SampleSettings {
    Lattice lattice;
    double halfWidth = 3; ///< voxels, in [1.5, 1000]
    std::string name = "surface";
    std::uint64_t maxBytes = 0; ///< memory of the grid, bytes; 0: no limit
    bool mayBeEmpty = false;    ///< without a zero crossing: an empty level set, not an InputError
    /// Box (world units) of the voxel centers to be sampled; a margin of kRegionMargin voxels
    /// around it is sampled too, or more where it takes more to decide about islands and handles,
    /// and dropped at the end. Inside the box the result is that of the whole; everything else is
    /// inactive and outside. A region without a surface is an empty level set.
    std::optional<Box3d> region;
};

/// Least margin around a region that is sampled too, voxels. [derived: the block about it in which
/// values are restored, and the one that those look at; it grows where signs are decided beyond]
constexpr int kRegionMargin = 16;

/// The voxels with their centers in @a region (world units).
openvdb::CoordBBox voxelsIn(const Box3d& region, const Lattice& lattice);

/// Sample @a field into a narrow band, which is found from the field's seeds by continuation and
/// closed: no sign change lies between inactive voxels.
/// @throws UsageError (settings, unbounded field), LimitError (memory, index range), InputError if
/// there is no zero crossing, Interrupted.
LevelSet sampleField(const Field& field, const SampleSettings& settings,
                     Interrupter* interrupter = nullptr);

/// Name of the grid of sampleCoverage().
constexpr const char* kCoverageName = "coverage";

/// @a coverage of the zero set of @a levelSet, in [0, 1], on the active voxels of its band: each
/// has the value of its nearest place on the zero set. Same transform; class unknown; inactive
/// voxels 0; called kCoverageName, with the quantity and the data's spacing as metadata. The same
/// for any number of threads. @throws Interrupted.
openvdb::FloatGrid::Ptr sampleCoverage(const LevelSet& levelSet, const Coverage& coverage,
                                       Interrupter* interrupter = nullptr);

/// The data's spacing, world units, from the metadata that sampleCoverage() wrote: 0 where values
/// are exact, else at least the size of the voxels, and that without metadata.
double coverageScale(const openvdb::FloatGrid& coverage);

/// How voxelize() repairs a broken mesh.
struct RepairSettings {
    /// The widest hole that is closed, world units: the diagonal of its box.
    double holes = std::numeric_limits<double>::infinity();
    /// Thickness of the walls made of open surfaces that enclose nothing, world units: at least two
    /// voxels; 0: they are left out.
    double thickness = 0;
};

/// The solid of a closed triangle mesh as a level set: all places with a winding number of at least
/// one [Barill18]. So parts that overlap, touch or are duplicates are one solid, and a part that
/// faces inward is a cavity of those around it. If all parts face inward, all are turned, as are
/// triangles that contradict their neighbors. Values are exact distances to the solid's boundary,
/// in the whole band; triangles within the solid do not count. Holes narrower than a voxel are
/// closed. LevelSet::explained() compares the result with the mesh.
/// @param settings  region and mayBeEmpty do not apply.
/// @throws InputError (no triangles, indices out of range, not finite, open, nothing enclosed),
/// UsageError (half-width), LimitError (memory, index range), Interrupted.
LevelSet voxelize(const Mesh& mesh, const SampleSettings& settings,
                  Interrupter* interrupter = nullptr);

/// The same for a broken mesh, of a closed one the same values. Inside is where the generalized
/// winding number is above one half, once patches face as their neighbors do, and outward, and
/// triangles with the same corners count once. So holes of any shape are closed by the surface
/// where the number is one half, which ends at their rims; for a plane rim it is plane. Distances
/// to the mesh's own triangles stay exact. Triangles with vertices that are not finite or not there
/// are left out. Explained::repair says what was done.
/// @throws as the other, but for open meshes InputError only if a hole is wider than
/// RepairSettings::holes; UsageError for a thickness below two voxels.
LevelSet voxelize(const Mesh& mesh, const SampleSettings& settings, const RepairSettings& repair,
                  Interrupter* interrupter = nullptr);

/// Side of a value that is inside.
enum class Inside {
    Above, ///< for densities
    Below  ///< for distances
};

/// The isosurface of @a grid, of any class, at @a value: a level set on the same lattice, called
/// "surface". The background has to be outside.
/// @param halfWidth  voxels, in [1.5, 1000]. @param maxBytes  memory for the surface of tiles,
/// bytes; 0: no limit.
/// @throws UsageError (value, half-width), InputError (voxels that are not cubes, values that are
/// not finite, nothing inside), LimitError (memory, before it is used), Interrupted.
LevelSet isosurface(const openvdb::FloatGrid& grid, double value, Inside inside, double halfWidth,
                    std::uint64_t maxBytes = 0, Interrupter* interrupter = nullptr);

} // namespace mpuvdb
