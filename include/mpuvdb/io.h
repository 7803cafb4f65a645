// Files in and out. Readers take their format from the content where it has a magic number, else
// from the extension; writers from the extension. Output appears whole or not at all.
#pragma once
#include <mpuvdb/level_set.h>
#include <mpuvdb/mesh.h>
#include <mpuvdb/point_cloud.h>

#include <filesystem>
#include <functional>
#include <iosfwd>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// What to do with points that cannot be used as they are: not finite, absurdly far, zero normal.
enum class BadPoints {
    Drop, ///< leave them out, count them
    Fail  ///< InputError at the first
};

/// Points read from one or more files, joined.
struct PointInput {
    PointCloud cloud;
    /// Points left out, by reason ("not finite", "zero normal", "duplicate" ...).
    std::map<std::string, std::uint64_t> dropped;
    std::uint64_t triangles = 0; ///< of the files that are meshes; their vertices are the points
    std::vector<std::string> scalarNames; ///< that all files have, whether asked for or not
    /// What a user should know ("bunny.ply: normals computed from its 69451 faces").
    std::vector<std::string> notes;
    /// What a user has to know: that positions were rounded far above the points' spacing.
    std::vector<std::string> warnings;
};

/// Read points: PLY, Stanford .conf scan sets, XYZ/PTS/PWN/TXT, PTX, OBJ, OFF, STL, PCD, LAS.
/// A mesh gives its vertices with area-weighted normals, a range grid normals and confidences
/// [Curless96]. Normals are kept only if every file has them; "-" is stdin (PLY or text).
/// Range grids, PTX, and PCD with rows and without normals tell the viewpoints of their points.
/// @param viewpoints  instead of those: none, one for all files, or one for each; world units.
/// @param scalars  names of numbers to keep with the points, at most 8: properties of PLY and PCD,
/// named columns of text, LAS's "intensity". What is not finite there becomes 0.
/// @throws IoError (cannot read), InputError (malformed: file, line or byte, and the cure; an input
/// without one of the scalars), UsageError (another number of viewpoints, too many scalars).
PointInput readPoints(const std::vector<std::filesystem::path>& files, BadPoints badPoints,
                      const std::vector<Vec3d>& viewpoints = {},
                      const std::vector<std::string>& scalars = {},
                      Interrupter* interrupter = nullptr);

/// Read a triangle mesh: PLY, OBJ, OFF, STL (whose equal corners become one vertex); "-" is stdin
/// (PLY). Polygons become fans; vertices without a triangle are left out. Colors of the vertices
/// are kept. The frame is the middle of the mesh.
/// @throws IoError (cannot read), InputError (malformed, no triangles, vertices not finite).
Mesh readMesh(const std::filesystem::path& file, Interrupter* interrupter = nullptr);

/// Points that a program holds in memory: attributes are empty, or one per point.
struct PointArrays {
    std::vector<Vec3d> positions;   ///< world units
    std::vector<Vec3f> normals;     ///< outward, of any length
    std::vector<float> confidence;  ///< of any scale
    std::optional<Vec3d> viewpoint; ///< where all were seen from, world units
};

/// What readPoints() does to the points of a file, done to these. @param name  for messages.
/// @throws UsageError (another number of normals or confidences than of points), InputError.
PointInput importPoints(PointArrays&& points, const std::string& name, BadPoints badPoints,
                        Interrupter* interrupter = nullptr);

/// Write points as binary PLY (float offsets become doubles) or XYZ text.
void writePoints(const std::filesystem::path& file, const PointCloud& cloud,
                 Interrupter* interrupter = nullptr);

/// What the world's axes and units are, for the formats that tell it: GLB and USDA.
struct SceneSettings {
    UpAxis up = UpAxis::Y;
    double metersPerUnit = 1; ///< meters in a world unit, above 0
};

/// Write a mesh by extension: .ply (binary), .obj, .off, .stl (binary), .glb (binary glTF 2.0),
/// .usda. Positions keep the precision that they have about the frame, except in STL: PLY, OBJ and
/// OFF get doubles far from the origin, GLB and USDA a translation. GLB is turned to Y up and
/// scaled to meters by its node. Colors go to all but STL (linear in GLB and USDA, else sRGB),
/// scalars to PLY, GLB ("_NAME") and USDA ("primvars:NAME").
/// @throws UsageError (another extension, attributes of another number, settings out of range),
/// LimitError (more than the format can hold: 4 GiB for GLB), IoError, Interrupted.
void writeMesh(const std::filesystem::path& file, const Mesh& mesh, const SceneSettings& scene = {},
               Interrupter* interrupter = nullptr);

/// The extensions that writeMesh() knows, lower case, with their dots.
const std::vector<std::string>& meshExtensions();

/// Write a .usda layer whose volume shows the grids of @a vdb by a path relative to the layer.
/// @param grids  of the file: all have names; their boxes give the extent.
/// @throws UsageError (settings out of range), IoError.
void writeVolumeLayer(const std::filesystem::path& file, const std::filesystem::path& vdb,
                      const openvdb::GridCPtrVec& grids, const SceneSettings& scene = {});

/// What a level set is read for.
enum class Purpose {
    Modelling, ///< its values have to be distances, see requireDistances()
    Looking    ///< its zero set is all that counts
};

/// Read one level set of a .vdb file, as levelSetFromGrid() takes it: the grid called @a name, or,
/// if empty, "surface" or the only level set. @param maxBytes  that the grid may take, by what its
/// file says; 0: no limit. @param interrupter  gets notes of what was mended.
/// @throws IoError, InputError (not a .vdb, truncated, no such grid: lists those there; no
/// distances), LimitError, Interrupted.
LevelSet readLevelSet(const std::filesystem::path& file, const std::string& name = {},
                      std::uint64_t maxBytes = 0, Purpose purpose = Purpose::Modelling,
                      Interrupter* interrupter = nullptr);

/// A level set, and the other grids of its file.
struct LevelSetFile {
    LevelSet levelSet;
    openvdb::GridCPtrVec others;
    std::vector<std::string> notes; ///< what was mended, for the user
};

/// As readLevelSet() for modelling, with all that is beside.
LevelSetFile readLevelSetFile(const std::filesystem::path& file, const std::string& name = {},
                              std::uint64_t maxBytes = 0, Interrupter* interrupter = nullptr);

/// A grid of floats, of any class, and the other grids of its file.
struct FloatGridFile {
    openvdb::FloatGrid::Ptr grid;
    openvdb::GridCPtrVec others;
};

/// Read the grid called @a name, or, if empty, the first of floats. @throws as readLevelSet().
FloatGridFile readFloatGridFile(const std::filesystem::path& file, const std::string& name = {},
                                std::uint64_t maxBytes = 0, Interrupter* interrupter = nullptr);

/// The grid that sampleCoverage() made, from a .vdb file. @throws IoError, InputError (as
/// readLevelSet; no such grid), LimitError.
openvdb::FloatGrid::Ptr readCoverage(const std::filesystem::path& file, std::uint64_t maxBytes = 0,
                                     Interrupter* interrupter = nullptr);

/// The grids called @a names of a .vdb file, in their order: null where there is none of floats or
/// Vec3f. @param maxBytes  for all of them. @throws IoError, InputError (as readLevelSet),
/// LimitError.
std::vector<openvdb::GridBase::Ptr> readAttributeGrids(const std::filesystem::path& file,
                                                       const std::vector<std::string>& names,
                                                       std::uint64_t maxBytes = 0,
                                                       Interrupter* interrupter = nullptr);

/// All grids of a .vdb file, with the checks of readLevelSet that do not depend on class or type.
/// Truncated files and damaged heads are refused. OpenVDB and Blosc trust compressed voxels: damage
/// there may crash, so read strangers' files in a process of their own.
openvdb::GridPtrVec readGrids(const std::filesystem::path& file, std::uint64_t maxBytes = 0,
                              Interrupter* interrupter = nullptr);

/// Write a level set with @a metadata added ("mpuvdb:tolerance" -> "0.001"), and after it the grids
/// of @a beside, of other names, as they are. Equal grids and metadata give equal bytes.
/// @throws IoError, Interrupted.
void writeLevelSet(const std::filesystem::path& file, const LevelSet& levelSet,
                   const std::map<std::string, std::string>& metadata,
                   const openvdb::GridCPtrVec& beside = {}, Interrupter* interrupter = nullptr);

/// Write @a grids as they are, as writeLevelSet() does.
void writeGrids(const std::filesystem::path& file, const openvdb::GridCPtrVec& grids,
                Interrupter* interrupter = nullptr);

} // namespace mpuvdb
