// Triangle meshes: extracted from level sets, and measured.
#pragma once
#include <mpuvdb/attribute_grids.h>
#include <mpuvdb/level_set.h>
#include <mpuvdb/point_cloud.h>
#include <mpuvdb/triangle_mesh.h>

#include <cstdint>

namespace mpuvdb
{

/// How a level set becomes a mesh.
struct ExtractSettings {
    /// What the level set was sampled from, if it is at hand: creases are then as exact as it is.
    const Field* field = nullptr;
    /// Look for triangles that cross, and give up what makes them do so.
    bool strict = false;
};

/// The zero set as triangles, by dual contouring: one vertex for each sheet of the surface in each
/// cell between eight voxels, on creases and corners where there are some, at most half a voxel
/// outside its cell; creases come from the field, or from the values on each side of them. Closed
/// and manifold whatever the values are [Wenger13 §3.3]; triangles face outwards, those that would
/// fold over at creases are drawn back. Far from the origin nothing is rounded. The same for any
/// number of threads. @throws LimitError beyond 2^32 vertices, Interrupted. [Ju02]
Mesh extractMesh(const LevelSet& levelSet, const ExtractSettings& settings = {},
                 Interrupter* interrupter = nullptr);

/// How a mesh is simplified.
struct SimplifySettings {
    double tolerance = 0; ///< world units, > 0
    /// Keep what crossing triangles were made from, and start again until none cross but those that
    /// did before; see findSelfIntersections().
    bool strict = false;
};

/// @a mesh with fewer triangles: no vertex of @a mesh lies farther from the result than the
/// tolerance, and no vertex nor middle of an edge of the result farther from @a mesh. Edges are
/// collapsed where that costs least, so that creases stay; a manifold stays one, of the same genus;
/// boundaries stay as they are; colors change by at most 6 % of white, other attributes are
/// interpolated. The same for any number of threads, of which it uses one: about 20 us for each
/// vertex. @throws UsageError for a tolerance that is not above 0, Interrupted. [Garland97]
Mesh simplify(const Mesh& mesh, const SimplifySettings& settings,
              Interrupter* interrupter = nullptr);

/// What stays of a mesh that is trimmed where coverage is below one half. Sizes are the largest
/// distance between two places of an uncovered patch or of a covered part, its rim included.
struct TrimSettings {
    double closeUpTo = 0; ///< holes of at most this size stay closed, world units
    double islands = 0;   ///< covered parts inside a hole go up to this size, world units
};

/// What trimMesh() met.
struct TrimReport {
    std::uint64_t closed = 0;  ///< holes that were small enough to stay closed
    std::uint64_t open = 0;    ///< holes left open
    std::uint64_t islands = 0; ///< covered parts taken away
};

/// Settings for @a coverage as sampleCoverage() makes it: holes up to @a closeUpTo (world units)
/// stay closed, and in any case those that are no more than a gap between two points; islands that
/// a handful of stray points make go.
TrimSettings trimSettings(const openvdb::FloatGrid& coverage, double closeUpTo);

/// Cut the triangles of @a mesh along the line where @a coverage, a grid of any lattice, is one
/// half, and drop those below: smoothed over a few edges so that the line is no rougher than the
/// mesh, and with vertices near the line drawn onto it so that no slivers come about. The result is
/// manifold with boundary if @a mesh is manifold; the vertices away from the line are as they were,
/// and attributes of those on it are interpolated.
/// Where there is no active voxel, nothing is covered. The same for any number of threads.
/// @throws Interrupted.
Mesh trimMesh(Mesh mesh, const openvdb::FloatGrid& coverage, const TrimSettings& settings,
              TrimReport& report, Interrupter* interrupter = nullptr);

/// Give the vertices what @a attributes say of them: colors, and scalars beside those that there
/// are. @throws Interrupted.
void addAttributes(Mesh& mesh, const SurfaceAttributes& attributes,
                   Interrupter* interrupter = nullptr);

/// Give the vertices what @a grid, of any lattice, says there: a Vec3f grid colors, a float grid a
/// scalar of its name, others nothing. Only active voxels count; 0 where there are none.
/// @throws Interrupted.
void addAttribute(Mesh& mesh, const openvdb::GridBase& grid, Interrupter* interrupter = nullptr);

/// What is known of a mesh without looking at it.
struct MeshReport {
    std::uint64_t vertices = 0, triangles = 0;
    std::uint64_t components = 0;         ///< by shared vertices
    std::uint64_t boundaryEdges = 0;      ///< with one triangle
    std::uint64_t boundaryLoops = 0;      ///< connected parts of the boundary
    std::uint64_t nonManifoldEdges = 0;   ///< with more than two, or two that disagree in direction
    std::int64_t eulerCharacteristic = 0; ///< of the vertices that are used
    double genus = 0;                     ///< handles, of all parts; if there are no bad edges
    double area = 0, volume = 0;          ///< world units squared, cubed; volume signed
    /// Of the triangles' smallest angles the least, and that which one in a hundred falls short of:
    /// degrees, 0 for triangles without area.
    double smallestAngle = 0, firstPercentileAngle = 0;
};

/// Measure @a mesh, whose indices are valid; the same for any number of threads.
MeshReport measure(const Mesh& mesh);

/// Two triangles of a mesh by their indices, the lower first.
using TrianglePair = std::array<std::uint32_t, 2>;

/// The pairs of triangles that cross, sorted: a side of one runs through the inside of the other.
/// Pairs with a common edge do not count, nor does what only touches or overlaps within one plane.
/// Exact on positions rounded to 2^-30 of the mesh's size. The same for any number of threads.
/// @throws Interrupted.
std::vector<TrianglePair> findSelfIntersections(const Mesh& mesh,
                                                Interrupter* interrupter = nullptr);

/// Distances from places on one surface to the nearest place of another, world units.
struct Distances {
    double mean = 0, rms = 0, max = 0;
};

/// Distances both ways.
struct TwoWayDistances {
    Distances there, back; ///< from the first to the second, and from the second
};

/// Distances between two meshes that have triangles, weighted by area: from half a million places
/// on each, spread evenly, to the nearest place of the other; the largest looks at the vertices
/// too. The same for any number of threads. @throws UsageError without triangles, Interrupted.
TwoWayDistances distances(const Mesh& mesh, const Mesh& other, Interrupter* interrupter = nullptr);

/// Distances from places on a mesh to the nearest point, and from each point to the mesh; otherwise
/// as above. @throws UsageError without triangles or points, Interrupted.
TwoWayDistances distances(const Mesh& mesh, const PointCloud& points,
                          Interrupter* interrupter = nullptr);

} // namespace mpuvdb
