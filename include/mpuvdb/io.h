// Reading and writing files. Readers take the format from the content where it has a magic number,
// else from the extension; writers from the extension. Output appears whole or not at all.
#pragma once
#include <mpuvdb/level_set.h>
#include <mpuvdb/mesh.h>
#include <mpuvdb/particles.h>
#include <mpuvdb/point_input.h>

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
class SurfaceAttributes;

/// Reads points: PLY, Stanford .conf scan sets, XYZ/PTS/PWN/TXT, PTX, OBJ, OFF, STL, PCD, LAS; "-"
/// is stdin (PLY or text). A mesh gives its vertices with area-weighted normals, a range grid
/// normals and confidences [Curless96]. Normals are kept only if every file has them. Range grids,
/// PTX, and PCD with rows and without normals have viewpoints.
/// @param viewpoints  replace these: none, one for all files, or one for each; world units.
/// @param scalars  names of numbers to keep with the points, at most 8: properties of PLY and PCD,
/// named columns of text, LAS's "intensity". Values that are not finite become 0.
/// @throws IoError (cannot read), InputError (malformed: file, line or byte, and the cure; an input
/// without one of the scalars), UsageError (another number of viewpoints, too many scalars),
/// Interrupted.
PointInput readPoints(const std::vector<std::filesystem::path>& files, BadPoints badPoints,
                      const std::vector<Vec3d>& viewpoints = {},
                      const std::vector<std::string>& scalars = {},
                      Interrupter* interrupter = nullptr);

/// Reads particles: every file that readPoints() reads, with radii and velocities by
/// ParticleNames::among(), and the point grids of a .vdb file, whose attributes are "P", "pscale"
/// or "radius", "v", "Cd" and scalars by name. Normals and confidences are left.
/// @param files  one .vdb file, or others, which are joined; no standard input.
/// @param scalars  names of numbers to keep with the particles, at most 4.
/// @param maxBytes  limit of the point grids' memory by their metadata; 0: none.
/// @throws IoError, InputError and UsageError as readPoints(); InputError for a .vdb file without
/// points, LimitError, Interrupted.
Particles readParticles(const std::vector<std::filesystem::path>& files,
                        const std::vector<std::string>& scalars = {}, std::uint64_t maxBytes = 0,
                        Interrupter* interrupter = nullptr);

/// What readMesh() does with vertices that are not finite.
enum class BadVertices {
    Refuse,
    Keep ///< for repair; the frame is that of the others
};

/// Reads a triangle mesh: PLY, OBJ, OFF, STL (whose equal corners become one vertex); "-" is stdin
/// (PLY). Polygons become fans; vertices without a triangle are left out; colors are kept. The
/// frame is the middle of the mesh.
/// @param scalars  names of vertices' numbers to keep, at most 4 ("quality" is one; PLY only).
/// @throws IoError (cannot read), InputError (malformed, no triangles, vertices not finite, a
/// scalar is missing), UsageError (too many scalars), Interrupted.
Mesh readMesh(const std::filesystem::path& file, Interrupter* interrupter = nullptr,
              BadVertices bad = BadVertices::Refuse, const std::vector<std::string>& scalars = {});

/// Writes points as binary PLY, with double positions, or as text (.xyz, .txt, .pwn).
/// @throws UsageError (another extension), IoError, Interrupted.
void writePoints(const std::filesystem::path& file, const PointCloud& cloud,
                 Interrupter* interrupter = nullptr);

/// The world's up axis and unit, for the formats that store them: GLB and USDA.
struct SceneSettings {
    UpAxis up = UpAxis::Y;
    double metersPerUnit = 1; ///< meters in a world unit, above 0
};

/// Writes a mesh by extension: .ply (binary), .obj, .off, .stl (binary), .glb (binary glTF 2.0),
/// .usda. Positions keep their precision, except in STL: PLY, OBJ and OFF have doubles far from the
/// origin, GLB and USDA a translation. GLB is turned to Y up and scaled to meters by its node. All
/// but STL have colors (linear in GLB and USDA, else sRGB); PLY, GLB ("_NAME") and USDA
/// ("primvars:NAME") have scalars.
/// @throws UsageError (another extension, attributes of another number, settings out of range),
/// InputError (places that floats do not hold), LimitError (GLB over 4 GiB), IoError, Interrupted.
void writeMesh(const std::filesystem::path& file, const Mesh& mesh, const SceneSettings& scene = {},
               Interrupter* interrupter = nullptr);

/// The extensions of writeMesh(), lower case, with their dots.
const std::vector<std::string>& meshExtensions();

/// Writes a .usda layer with a volume of the grids of @a vdb, by a path relative to the layer.
/// @param grids  of that file: all have names; their boxes give the extent.
/// @throws UsageError (settings out of range), IoError.
void writeVolumeLayer(const std::filesystem::path& file, const std::filesystem::path& vdb,
                      const openvdb::GridCPtrVec& grids, const SceneSettings& scene = {});

/// One frame of a volume that changes with time.
struct VolumeFrame {
    int number = 0; ///< its time code
    std::filesystem::path vdb;
};

/// Writes a .usda layer with a volume whose file changes with time: the path of each frame is a
/// time sample. Grids that a frame's file does not have are blocked there.
/// @param frames  at least one, by ascending numbers; the heads of their files are read.
/// @throws UsageError (settings out of range, no frames or not ascending), IoError, InputError (as
/// readLevelSet()).
void writeVolumeLayer(const std::filesystem::path& file, const std::vector<VolumeFrame>& frames,
                      const SceneSettings& scene = {});

/// One of several volumes that are shown together.
struct VolumePart {
    std::filesystem::path vdb; ///< its stem names the volume
    bool isProxy = false;      ///< stands for all others, which are for rendering
};

/// Writes a .usda layer with a volume for each of @a parts, with all grids of its file: USD's
/// purposes (render, proxy) say what shows them.
/// @throws UsageError (settings out of range), IoError, InputError (as readLevelSet()).
void writeVolumeLayer(const std::filesystem::path& file, const std::vector<VolumePart>& parts,
                      const SceneSettings& scene = {});

/// The checks of a level set that is read.
enum class Validation {
    Distances, ///< values become distances where they are none, as by distancesFromGrid()
    SignsOnly  ///< any values with the right zero set
};

/// Reads one level set of a .vdb file, as levelSetFromGrid() takes it.
/// @param name  of the grid; empty: "surface", or the only level set.
/// @param maxBytes  limit of the grid's memory by its metadata; 0: none.
/// @param interrupter  gets notes of repairs.
/// @throws IoError, InputError (not a .vdb, truncated, no such grid: lists the others; no
/// distances), LimitError, Interrupted.
LevelSet readLevelSet(const std::filesystem::path& file, const std::string& name = {},
                      std::uint64_t maxBytes = 0, Validation validation = Validation::Distances,
                      Interrupter* interrupter = nullptr);

/// A level set, and the other grids of its file.
struct LevelSetFile {
    LevelSet levelSet;
    openvdb::GridCPtrVec others;
    openvdb::MetaMap metadata;      ///< of the file itself
    std::vector<std::string> notes; ///< of repairs, for the user
};

/// As readLevelSet() with Validation::Distances, and the file's other grids.
LevelSetFile readLevelSetFile(const std::filesystem::path& file, const std::string& name = {},
                              std::uint64_t maxBytes = 0, Interrupter* interrupter = nullptr);

/// A grid of floats, of any class, and the other grids of its file.
struct FloatGridFile {
    openvdb::FloatGrid::Ptr grid;
    openvdb::GridCPtrVec others;
    openvdb::MetaMap metadata; ///< of the file itself
};

/// Reads the grid called @a name, or, if empty, the first float grid. @throws as readLevelSet().
FloatGridFile readFloatGridFile(const std::filesystem::path& file, const std::string& name = {},
                                std::uint64_t maxBytes = 0, Interrupter* interrupter = nullptr);

/// Reads the grid of sampleCoverage() from a .vdb file. @throws IoError, InputError (as
/// readLevelSet; no such grid), LimitError.
openvdb::FloatGrid::Ptr readCoverage(const std::filesystem::path& file, std::uint64_t maxBytes = 0,
                                     Interrupter* interrupter = nullptr);

/// Reads the grids called @a names of a .vdb file, in their order: null where there is no float or
/// Vec3f grid. @param maxBytes  limit of their memory together; 0: none. @throws IoError,
/// InputError (as readLevelSet), LimitError.
std::vector<openvdb::GridBase::Ptr> readAttributeGrids(const std::filesystem::path& file,
                                                       const std::vector<std::string>& names,
                                                       std::uint64_t maxBytes = 0,
                                                       Interrupter* interrupter = nullptr);

/// Reads all grids of a .vdb file, with the checks of readLevelSet() that do not depend on class or
/// type. Truncated files and damaged heads are refused. OpenVDB and Blosc trust compressed voxels:
/// damage there may crash, so read untrusted files in a process of their own.
openvdb::GridPtrVec readGrids(const std::filesystem::path& file, std::uint64_t maxBytes = 0,
                              Interrupter* interrupter = nullptr);

/// Reads the metadata of a .vdb file itself, which are no grid's. @throws IoError, InputError (as
/// readLevelSet()).
openvdb::MetaMap readFileMetadata(const std::filesystem::path& file);

/// Reads names, classes, transforms and metadata of all grids of a .vdb file; their trees are
/// empty.
/// @throws IoError, InputError (as readLevelSet()).
openvdb::GridCPtrVec readGridHeads(const std::filesystem::path& file);

/// The grids that sampleAttributes() makes, for writeLevelSet(): they have no voxels in memory, but
/// their leaves as the file will have them, a quarter of the bytes or less. Nothing else can be
/// done with them. @param levelSet  its tree is to stay as it is until they are written.
/// @param interrupter  may stop the writing, too; has to outlive the grids.
/// @throws as sampleAttributes().
openvdb::GridCPtrVec compressAttributes(const LevelSet& levelSet,
                                        const SurfaceAttributes& attributes,
                                        Interrupter* interrupter = nullptr);

/// Writes a level set with @a metadata added ("mpuvdb:tolerance" -> "0.001"), and after it the
/// grids of @a beside, of other names, as they are. Equal grids and metadata give equal bytes.
/// @throws UsageError for metadata under OpenVDB's own names ("class"), IoError, Interrupted.
void writeLevelSet(const std::filesystem::path& file, const LevelSet& levelSet,
                   const std::map<std::string, std::string>& metadata,
                   const openvdb::GridCPtrVec& beside = {}, Interrupter* interrupter = nullptr);

/// The same, with metadata of the file itself.
void writeLevelSet(const std::filesystem::path& file, const LevelSet& levelSet,
                   const std::map<std::string, std::string>& metadata,
                   const openvdb::GridCPtrVec& beside, const openvdb::MetaMap& ofFile,
                   Interrupter* interrupter = nullptr);

/// Writes @a grids as they are, else as writeLevelSet().
void writeGrids(const std::filesystem::path& file, const openvdb::GridCPtrVec& grids,
                Interrupter* interrupter = nullptr);
void writeGrids(const std::filesystem::path& file, const openvdb::GridCPtrVec& grids,
                const openvdb::MetaMap& ofFile, Interrupter* interrupter = nullptr);

} // namespace mpuvdb
