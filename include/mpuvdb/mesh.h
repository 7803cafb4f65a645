// Triangle meshes: extracted from level sets, and measured.
#pragma once
#include <mpuvdb/attribute_grids.h>
#include <mpuvdb/level_set.h>
#include <mpuvdb/point_cloud.h>
#include <mpuvdb/triangle_mesh.h>

#include <cstdint>

namespace mpuvdb
{

/// Settings of extractMesh().
struct ExtractSettings {
    /// The field that the level set was sampled from, or null: it makes creases exact.
    const Field* field = nullptr;
    /// Retract vertices until no triangles cross.
    bool strict = false;
};

/// The zero set as triangles, by dual contouring [Ju02]: one vertex for each sheet of the surface
/// in each cell between eight voxels, on creases and corners where there are some, at most half a
/// voxel outside its cell; creases come from the field, or from the values beside them. Closed and
/// manifold for any values [Wenger13 §3.3]; triangles face outwards, and vertices of those that
/// fold over at creases are retracted. Exact far from the origin. The same for any number of
/// threads. @throws LimitError beyond 2^32 vertices, Interrupted.
Mesh extractMesh(const LevelSet& levelSet, const ExtractSettings& settings = {},
                 Interrupter* interrupter = nullptr);

/// Settings of simplify().
struct SimplifySettings {
    double tolerance = 0; ///< world units, > 0
    /// Hold the vertices that crossing triangles were made from, and start again until none cross
    /// but those that did before; see findSelfIntersections().
    bool strict = false;
};

/// @a mesh with fewer triangles, by edge collapses in the order of quadric errors [Garland97]. No
/// vertex of @a mesh lies farther from the result than the tolerance, and no vertex or edge's
/// middle of the result farther from @a mesh. A manifold keeps its genus; boundaries stay as they
/// are; colors change by at most 6 % of white, other attributes are interpolated. About 20 us of
/// one thread for each vertex; the same for any number of threads.
/// @throws UsageError for a tolerance that is not above 0, Interrupted.
Mesh simplify(const Mesh& mesh, const SimplifySettings& settings,
              Interrupter* interrupter = nullptr);

/// Settings of trimMesh(). Sizes are the largest distance between two places of an uncovered patch
/// or of a covered part, its rim included, world units.
struct TrimSettings {
    double closeUpTo = 0; ///< holes up to this size stay closed
    double islands = 0;   ///< covered parts inside a hole are removed up to this size
};

/// Counts of trimMesh().
struct TrimReport {
    std::uint64_t closed = 0;  ///< holes that stayed closed
    std::uint64_t open = 0;    ///< holes left open
    std::uint64_t islands = 0; ///< covered parts removed
};

/// Settings for @a coverage as sampleCoverage() makes it: holes up to @a closeUpTo (world units)
/// stay closed, and at least gaps between two points; islands of a dozen stray points are removed.
TrimSettings trimSettings(const openvdb::FloatGrid& coverage, double closeUpTo);

/// The part of @a mesh where @a coverage, a grid of any lattice, is at least one half; inactive
/// voxels are uncovered. Coverage is smoothed over a few edges, so that the line is no rougher than
/// the mesh, and vertices near the line are moved onto it, so that there are no slivers. Manifold
/// with boundary if @a mesh is manifold; vertices away from the line stay as they are, attributes
/// on it are interpolated. The same for any number of threads. @throws Interrupted.
Mesh trimMesh(Mesh mesh, const openvdb::FloatGrid& coverage, const TrimSettings& settings,
              TrimReport& report, Interrupter* interrupter = nullptr);

/// Sets the vertices' colors by @a attributes, and adds its scalars. @throws Interrupted.
void addAttributes(Mesh& mesh, const SurfaceAttributes& attributes,
                   Interrupter* interrupter = nullptr);

/// Sets the vertices' colors by a Vec3f @a grid of any lattice, or adds a scalar of its name by a
/// float grid; other grids are ignored. Only active voxels count; 0 where there are none.
/// @throws Interrupted.
void addAttribute(Mesh& mesh, const openvdb::GridBase& grid, Interrupter* interrupter = nullptr);

/// The measures of a mesh.
struct MeshReport {
    std::uint64_t vertices = 0, triangles = 0;
    std::uint64_t components = 0;         ///< by shared vertices
    std::uint64_t boundaryEdges = 0;      ///< with one triangle
    std::uint64_t boundaryLoops = 0;      ///< connected parts of the boundary
    std::uint64_t nonManifoldEdges = 0;   ///< with more than two, or two that disagree in direction
    std::int64_t eulerCharacteristic = 0; ///< of the vertices that are used
    double genus = 0;                     ///< handles, of all parts; if there are no bad edges
    double area = 0, volume = 0;          ///< world units squared, cubed; volume signed
    /// The least of the triangles' smallest angles, and their first percentile: degrees, 0 for
    /// triangles without area.
    double smallestAngle = 0, firstPercentileAngle = 0;
};

/// Measures @a mesh, whose indices are valid; the same for any number of threads.
MeshReport measure(const Mesh& mesh);

/// The indices of two triangles of a mesh, the lower first.
using TrianglePair = std::array<std::uint32_t, 2>;

/// The pairs of triangles that cross, sorted: their insides meet. Pairs with a common edge, or that
/// only touch or overlap in a plane, do not count. Exact on positions rounded to 2^-30 of the
/// mesh's size. The same for any number of threads. @throws Interrupted.
std::vector<TrianglePair> findSelfIntersections(const Mesh& mesh,
                                                Interrupter* interrupter = nullptr);

/// Distances from places on one surface to the nearest place of another, world units.
struct Distances {
    double mean = 0, rms = 0, max = 0;
};

/// Distances both ways.
struct TwoWayDistances {
    Distances there, back; ///< from the first to the second, and from the second to the first
};

/// Distances between two meshes, weighted by area: from half a million places on each, spread
/// evenly, to the nearest place of the other; the largest is also over the vertices. The same for
/// any number of threads. @throws UsageError for a mesh without triangles, Interrupted.
TwoWayDistances distances(const Mesh& mesh, const Mesh& other, Interrupter* interrupter = nullptr);

/// Distances from places on a mesh to the nearest point, and from each point to the mesh, else as
/// between meshes. @throws UsageError without triangles or points, Interrupted.
TwoWayDistances distances(const Mesh& mesh, const PointCloud& points,
                          Interrupter* interrupter = nullptr);

} // namespace mpuvdb
