// What becomes a level set: fields, meshes, and grids of any class; and attributes on its surface.
#pragma once
#include <mpuvdb/level_set.h>
#include <mpuvdb/triangle_mesh.h>

#include <cstdint>
#include <optional>
#include <string>

namespace mpuvdb
{

class Interrupter;

/// How a field becomes a grid.
struct SampleSettings {
    Lattice lattice;
    double halfWidth = 3; ///< voxels, in [1.5, 1000]
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

/// Sample @a field into a narrow band: searched from its seeds by continuation, closed so that no
/// sign change lies between inactive voxels, inactive space signed.
/// @throws LimitError (memory, index range), InputError if there is no zero crossing, Interrupted.
LevelSet sampleField(const Field& field, const SampleSettings& settings,
                     Interrupter* interrupter = nullptr);

/// Name of the grid that says where data support the surface beside it.
constexpr const char* kCoverageName = "coverage";

/// What @a coverage says of the zero set of @a levelSet, on the active voxels of its band: each has
/// the value of the nearest place on the zero set (value times gradient away from it). Same
/// transform; class unknown, for it is neither a distance nor a density; inactive voxels 0; called
/// kCoverageName, with metadata that say what it is and the data's spacing. The same for any number
/// of threads. @throws Interrupted.
openvdb::FloatGrid::Ptr sampleCoverage(const LevelSet& levelSet, const Coverage& coverage,
                                       Interrupter* interrupter = nullptr);

/// The data's spacing as sampleCoverage() noted it in @a coverage, or the size of its voxels if
/// that is more (or nothing is noted): world units.
double coverageScale(const openvdb::FloatGrid& coverage);

/// The solid of closed triangle meshes as a level set, settings as for a field: all places around
/// which @a mesh winds at least once, so that parts that overlap, touch or are there twice are one
/// solid, and a part that faces inward is a cavity of those that it lies in. A mesh of which all
/// parts face inward is turned; triangles that contradict their neighbors are, too. In the whole
/// band the values are the distance to the nearest place on the solid's boundary, to rounding;
/// triangles within the solid do not count. Gaps of less than a voxel do not matter. The result is
/// held against the mesh: LevelSet::explained().
/// @throws InputError (no triangles, indices out of range, not finite, open), LimitError,
/// Interrupted.
LevelSet voxelize(const Mesh& mesh, const SampleSettings& settings,
                  Interrupter* interrupter = nullptr);

/// Which side of a value is inside.
enum class Inside {
    Above, ///< as of densities
    Below  ///< as of distances
};

/// The surface where @a grid, of any class, has @a value, between voxels: a level set on the same
/// lattice, called "surface". The background has to be outside. @param halfWidth  voxels, in
/// [1.5, 1000]. @param maxBytes  memory that the surface of tiles may take, which has no measure in
/// the file's size; 0: no limit. @throws UsageError (value, half-width), InputError (voxels that
/// are no cubes, values that are not finite, nothing inside), LimitError (memory, before it is
/// taken), Interrupted.
LevelSet isosurface(const openvdb::FloatGrid& grid, double value, Inside inside, double halfWidth,
                    std::uint64_t maxBytes = 0, Interrupter* interrupter = nullptr);

} // namespace mpuvdb
