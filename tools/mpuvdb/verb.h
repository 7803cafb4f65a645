// A verb of the command: its options and what it does.
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

/// Text of the help that is not an option's.
struct VerbText {
    const char* name;
    const char* summary;  ///< one line, for the list of verbs
    const char* examples; ///< commands with a comment each, for the verb's own help
};

class Verb
{
public:
    virtual ~Verb() = default;
    virtual VerbText text() const = 0;
    /// Declare options and positionals that write into this object.
    virtual void addOptions(CLI::App& app) = 0;
    /// Do it. @throws what the library throws.
    virtual ExitCode run(Session& session) = 0;
};

std::unique_ptr<Verb> makeReconstruct();
std::unique_ptr<Verb> makeMesh();
std::unique_ptr<Verb> makeSample();
std::unique_ptr<Verb> makeInfo();
std::unique_ptr<Verb> makeCheck();
std::unique_ptr<Verb> makeRender();
std::unique_ptr<Verb> makeUnion();
std::unique_ptr<Verb> makeIntersection();
std::unique_ptr<Verb> makeDifference();
std::unique_ptr<Verb> makeOffset();
std::unique_ptr<Verb> makeShell();
std::unique_ptr<Verb> makeSmooth();
std::unique_ptr<Verb> makeMorph();
std::unique_ptr<Verb> makeTwistVerb();
std::unique_ptr<Verb> makeTransform();
std::unique_ptr<Verb> makeResample();
std::unique_ptr<Verb> makeFog();
std::unique_ptr<Verb> makeIsosurface();
std::unique_ptr<Verb> makeComponents();
std::unique_ptr<Verb> makeVoxelize();

/// Declare an option whose value is a length with an optional unit.
CLI::Option* addLength(CLI::App& app, const std::string& name, std::optional<Length>& value,
                       const std::string& description);

/// The check that a value is one of @a words, which the option's type name shows already.
CLI::Validator oneOf(const std::vector<std::string>& words);
/// "--up y|z". @param says  what it is for.
CLI::Option* addUpAxis(CLI::App& app, UpAxis& up, const std::string& says);

/// Declare --grid, which names one grid of a .vdb file.
CLI::Option* addGridName(CLI::App& app, std::string& value);

/// What --holes asks for.
struct Holes {
    bool close = true;  ///< all of them
    Length closeUpTo{}; ///< else: those of at most this size

    std::string text() const
    {
        return close ? "close" : closeUpTo.value > 0 ? closeUpTo.text() : "open";
    }
};

/// Declare --holes.
CLI::Option* addHoles(CLI::App& app, Holes& holes);

/// Where the mesh is to be trimmed.
struct Trim {
    openvdb::FloatGrid::ConstPtr coverage; ///< null: nowhere
    double closeUpTo = 0;                  ///< holes of at most this size stay closed, world units
};

/// What --attributes asks for.
struct Attributes {
    bool automatic = true; ///< colors, where there are some
    std::vector<std::string> names;

    bool has(const std::string& name) const;
    /// Settle the names, now that it is known whether there are colors.
    /// @throws UsageError where colors are named, and there are none.
    void choose(bool colors);
    /// The names that are neither colors nor confidences.
    std::vector<std::string> scalars() const;
};

/// Declare --attributes. @param what  where they come from and where to, for the help.
CLI::Option* addAttributes(CLI::App& app, Attributes& attributes, const std::string& what);

/// Declare --up and --units.
void addScene(CLI::App& app, SceneSettings& scene);

/// What is asked of a mesh beside its place.
struct MeshShape {
    std::optional<Length> tolerance; ///< of its simplification; none: all triangles
    int lods = 0;                    ///< coarser meshes beside it
    bool strict = false;             ///< no triangles may cross
};

/// Declare the option called @a tolerance (such as "--tolerance"), --lods and --strict.
void addMeshShape(CLI::App& app, MeshShape& shape, const std::string& tolerance);

/// A mesh that a verb is to write.
struct MeshOutput {
    std::string path; ///< "-": PLY on standard output
    Trim trim;
    MeshShape shape;
    const Field* field = nullptr; ///< what the level set was sampled from, if known
    std::function<void(Mesh&, Interrupter&)> addAttributes; ///< empty: there are none
    SceneSettings scene;
};

/// The files that writeMeshOf() writes, as checkFiles() wants them.
std::vector<Output> filesOf(const MeshOutput& output, const std::string& option);

/// Extract the mesh of @a levelSet, write it, report it. @return CheckFailed where triangles cross
/// and were not to.
ExitCode writeMeshOf(const LevelSet& levelSet, const MeshOutput& output, Session& session);

} // namespace mpuvdb::command
