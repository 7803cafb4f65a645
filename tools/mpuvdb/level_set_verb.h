// What verbs have in common that make a level set from level sets.
#pragma once
#include "describe.h"
#include "verb.h"

#include <mpuvdb/shape.h>

#include <functional>
#include <vector>

namespace mpuvdb::command
{

/// A verb's input: the level set that was meant, and what else is in its file.
struct GridInput {
    std::string file;
    LevelSet levelSet;
    openvdb::GridCPtrVec others;
    openvdb::MetaMap metadata; ///< of the file itself
    double diagonal = 0;       ///< of the solid's box, world units

    /// @a length in world units.
    double resolve(const Length& length) const
    {
        return length.resolve(levelSet.voxelSize(), diagonal);
    }
};

/// A file, and the name of a grid in it.
struct GridPlace {
    std::string file, grid;
};

/// "file.vdb:NAME" as its two parts; other texts name a file alone, whose grid is @a grid.
/// @throws UsageError where both name a grid, and not the same.
GridPlace gridPlace(const std::string& text, const std::string& grid);

/// Read the grid called @a name (empty: surface, or the only level set) of @a file, which may name
/// its grid itself, as in gridPlace(); "-" is standard input.
GridInput readGridInput(const std::string& file, const std::string& name, Session& session);

/// Check @a levelSet, write it with @a metadata and the grids of @a beside ("-": to standard
/// output), report all that. @return CheckFailed if it is not sound.
/// @param ofFile  metadata of the file itself. @param gradientTolerance  of check().
ExitCode writeGridOutput(const LevelSet& levelSet, const std::string& output,
                         const std::map<std::string, std::string>& metadata,
                         const openvdb::GridCPtrVec& beside, Session& session,
                         const openvdb::MetaMap& ofFile = {},
                         double gradientTolerance = kGradientTolerance);

/// The grids of @a others that are not called @a name: what is made takes the place of such a one,
/// and a warning says so.
openvdb::GridCPtrVec besides(openvdb::GridCPtrVec others, const std::string& name,
                             Session& session);

/// Moves places of a result's surface to where they were before the operation; empty: they stayed.
using WayBack = std::function<void(std::vector<Vec3d>& places)>;

/// Level sets in, one level set out; grids beside them are carried.
class LevelSetVerb : public Verb
{
public:
    void addOptions(CLI::App& app) final;
    ExitCode run(Session& session) final;

protected:
    /// How many level sets it takes; most 0: any number.
    struct Count {
        int least = 1, most = 1;
    };
    virtual Count inputCount() const { return {}; }
    virtual void addOwnOptions(CLI::App& app) = 0;
    /// Files that own options name, which no output may replace.
    virtual std::vector<std::string> otherInputs() const { return {}; }
    /// What it makes; settings() becomes what the options came to.
    virtual LevelSet make(const std::vector<GridInput>& inputs, Session& session) = 0;
    /// The grids to write beside what was made: by default those of carriedGrids().
    virtual openvdb::GridCPtrVec
    gridsBeside(const LevelSet& made, const std::vector<GridInput>& inputs, Session& session) const;
    /// Where places of the result's surface were before, if they moved; set by make().
    WayBack& wayBack() { return mWayBack; }
    /// Resolved settings, for the report and as metadata of the grid.
    Json& settings() { return mSettings; }

private:
    std::vector<std::string> mInputs;
    std::string mOutput, mGrid;
    Json mSettings = Json::object();
    WayBack mWayBack;
};

/// Declare --voxel-size, of the result of several level sets.
void addSharedVoxelSize(CLI::App& app, std::optional<Length>& voxelSize);

/// The level sets of @a inputs on one lattice, of the finest or of @a voxelSize. Before the work
/// what it and @a result, which is made of them, take is said, and refused where it is too much.
/// What had to be resampled is noted, and stands in @a settings as "resampled".
/// @throws LimitError.
std::vector<LevelSet> onOneLattice(const std::vector<GridInput>& inputs, const Shape& result,
                                   const std::optional<Length>& voxelSize, Json& settings,
                                   Session& session);

/// To evaluate a shape on voxels like those of @a levelSet, in as wide a band.
ShapeSettings settingsLike(const LevelSet& levelSet, const Session& session);
/// The same for level sets on one lattice; the widest band counts.
ShapeSettings settingsLike(const std::vector<LevelSet>& levelSets, const Session& session);

std::vector<Shape> shapesOf(const std::vector<LevelSet>& levelSets);

/// "0.01 (5 vx)"
std::string lengthText(double length, double voxelSize);

/// Three numbers with commas between them. @param option  for the error's text.
Vec3d parseTriple(const std::string& option, const std::string& text);

/// Declare an option whose value is a direction: x, y or z, -x, -y or -z, or X,Y,Z.
CLI::Option* addDirection(CLI::App& app, const std::string& name, std::optional<Vec3d>& value,
                          const std::string& description);
/// Declare an option whose value is X,Y,Z.
CLI::Option* addTriple(CLI::App& app, const std::string& name, std::optional<Vec3d>& value,
                       const std::string& description);

} // namespace mpuvdb::command
