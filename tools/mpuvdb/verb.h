// The verbs of the command.
#pragma once
#include "exit_code.h"
#include "output_check.h"
#include "session.h"

#include <mpuvdb/error.h>
#include <mpuvdb/io.h>
#include <mpuvdb/length.h>
#include <mpuvdb/level_set.h>

#include <CLI/CLI.hpp>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace mpuvdb::command
{

/// The help text of a verb, without its options.
struct VerbText {
    const char* name;
    const char* summary;  ///< one line, for the list of verbs
    const char* examples; ///< commands with a comment each, for the verb's own help
};

/// A frame of a sequence, and the files that its run names.
struct FrameFiles {
    int frame = 0;
    std::vector<Output> outputs;
};

class Verb
{
public:
    virtual ~Verb() = default;
    virtual VerbText text() const = 0;
    /// Declares options and positionals that write into this object.
    virtual void addOptions(CLI::App& app) = 0;
    /// Runs the verb. @throws the library's exceptions.
    virtual ExitCode run(Session& session) = 0;
    /// Whether frames of a sequence differ though no input and no option has a place for their
    /// number.
    virtual bool movesByItself() const { return false; }
    /// Writes what is one file for all frames, once they are made; those in @a frames are there.
    virtual void joinFrames(const std::vector<FrameFiles>& /*frames*/) const {}
};

std::unique_ptr<Verb> makeReconstruct();
std::unique_ptr<Verb> makeParticles();
std::unique_ptr<Verb> makeMesh();
std::unique_ptr<Verb> makeSample();
std::unique_ptr<Verb> makeInfo();
std::unique_ptr<Verb> makeCheck();
std::unique_ptr<Verb> makeRender();
std::unique_ptr<Verb> makeUnion();
std::unique_ptr<Verb> makeIntersection();
std::unique_ptr<Verb> makeDifference();
std::unique_ptr<Verb> makeExclusiveOr();
std::unique_ptr<Verb> makeClip();
std::unique_ptr<Verb> makeMerge();
std::unique_ptr<Verb> makeSlice();
std::unique_ptr<Verb> makeOffset();
std::unique_ptr<Verb> makeShell();
std::unique_ptr<Verb> makeSmooth();
std::unique_ptr<Verb> makeMorph();
std::unique_ptr<Verb> makeTwistVerb();
std::unique_ptr<Verb> makeBendVerb();
std::unique_ptr<Verb> makeTaperVerb();
std::unique_ptr<Verb> makeTransform();
std::unique_ptr<Verb> makeResample();
std::unique_ptr<Verb> makeFog();
std::unique_ptr<Verb> makeIsosurface();
std::unique_ptr<Verb> makeComponents();
std::unique_ptr<Verb> makeVoxelize();
std::unique_ptr<Verb> makeMeasure();
std::unique_ptr<Verb> makeAnalyze();
std::unique_ptr<Verb> makePlan();
std::unique_ptr<Verb> makeTile();
std::unique_ptr<Verb> makeGather();
std::unique_ptr<Verb> makeStatus();

/// Declares an option whose value is a length with an optional unit.
CLI::Option* addLength(CLI::App& app, const std::string& name, std::optional<Length>& value,
                       const std::string& description);

/// The check that a value is one of @a words, which the option's type name already shows.
CLI::Validator oneOf(const std::vector<std::string>& words);
/// Declares --up y|z. @param help  its help text.
CLI::Option* addUpAxis(CLI::App& app, UpAxis& up, const std::string& help);

/// Declares --grid, which names one grid of a .vdb file.
CLI::Option* addGridName(CLI::App& app, std::string& value);

/// The value of --holes.
struct Holes {
    bool close = true;  ///< all holes
    Length closeUpTo{}; ///< else: holes of at most this size

    std::string text() const
    {
        return close ? "close" : closeUpTo.value > 0 ? closeUpTo.text() : "open";
    }
};

/// Declares --holes.
CLI::Option* addHoles(CLI::App& app, Holes& holes);

/// The settings of a trimmed mesh.
struct Trim {
    openvdb::FloatGrid::ConstPtr coverage; ///< null: it is not trimmed
    double closeUpTo = 0;                  ///< holes of at most this size stay closed, world units
};

/// The value of --attributes.
struct Attributes {
    bool automatic = true; ///< colors, if there are some
    std::vector<std::string> names;

    bool has(const std::string& name) const;
    /// Chooses the names by whether there are colors.
    /// @throws UsageError where colors are named, and there are none.
    void choose(bool colors);
    /// The names that are neither colors nor confidences.
    std::vector<std::string> scalars() const;
};

/// Declares --attributes. @param what  the help text.
CLI::Option* addAttributes(CLI::App& app, Attributes& attributes, const std::string& what);

/// The values of --up and --units.
struct Scene {
    SceneSettings settings;
    std::string given; ///< an option of the two that was given; empty: neither

    /// @throws UsageError where one was given, and none of @a outputs is of a format that stores
    /// it, nor a folder, which holds a USD layer.
    void requireUse(const std::vector<Output>& outputs) const;
};

/// Declares --up and --units.
void addScene(CLI::App& app, Scene& scene);

/// The options of a mesh's triangles.
struct MeshShape {
    std::optional<Length> tolerance; ///< of its simplification; none: all triangles
    int lods = 0;                    ///< number of coarser meshes
    bool strict = false;             ///< no triangles may cross
};

/// Declares the option called @a tolerance (such as "--tolerance"), --lods and --strict.
void addMeshShape(CLI::App& app, MeshShape& shape, const std::string& tolerance);

/// How far from the full mesh of a solid the one of @a shape may be, world units; 0: it is the full
/// one, or empty. @param diagonal  of the box of its active voxels; 0: there are none.
/// @throws UsageError where nothing of the solid's form would be left.
double toleranceOf(double voxelSize, double diagonal, const MeshShape& shape);
double toleranceOf(const LevelSet& levelSet, const MeshShape& shape);

/// A mesh that a verb writes.
struct MeshOutput {
    std::string path; ///< "-": PLY on standard output
    Trim trim;
    MeshShape shape;
    const Field* field = nullptr; ///< that the level set was sampled from, or null
    std::function<void(Mesh&, Interrupter&)> addAttributes; ///< empty: no attributes
    Scene scene;
};

/// The files that writeMeshes() writes, for checkFiles().
std::vector<Output> filesOf(const MeshOutput& output, const std::string& option);

/// Writes and reports the full @a mesh as output.shape says. @param tolerance  as toleranceOf().
/// @return CheckFailed where triangles cross in spite of MeshShape::strict.
ExitCode writeMeshes(Mesh mesh, double voxelSize, double tolerance, const MeshOutput& output,
                     Session& session);

/// Extracts the mesh of @a levelSet, and does the rest by writeMeshes().
ExitCode writeMeshOf(const LevelSet& levelSet, const MeshOutput& output, Session& session);

} // namespace mpuvdb::command
