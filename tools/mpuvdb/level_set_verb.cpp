#include "level_set_verb.h"

#include "carried_grids.h"

#include "memory_limit.h"
#include "standard_output.h"

#include <mpuvdb/io.h>

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <locale>
#include <optional>
#include <sstream>

namespace mpuvdb::command
{
namespace
{

/// A level set with the metadata of the grid that it was made of, but for what it has of its own.
LevelSet inheriting(const LevelSet& made, const openvdb::FloatGrid& of)
{
    openvdb::MetaMap metadata(of);
    metadata.insertMeta(made.grid());
    return {
        openvdb::gridConstPtrCast<openvdb::FloatGrid>(made.grid().copyReplacingMetadata(metadata)),
        made.explained()};
}

/// Voxels: what operations take at least, and what they get instead.
constexpr double kLeastHalfWidth = 1.5, kHalfWidth = 3;

} // namespace

GridPlace gridPlace(const std::string& text, const std::string& grid)
{
    std::size_t colon = text.find(':'); // the first one after a file: a grid's name may have some
    const auto isFile = [](const std::string& name) {
        return name == "-" || extensionOf(name) == ".vdb";
    };
    while (colon != std::string::npos && !isFile(text.substr(0, colon)))
        colon = text.find(':', colon + 1);
    std::error_code ignored;
    if (colon == std::string::npos || colon + 1 == text.size() ||
        std::filesystem::exists(text, ignored))
        return {text, grid};
    const std::string file = text.substr(0, colon), own = text.substr(colon + 1);
    if (!grid.empty() && grid != own)
        throw UsageError(fmt::format("--grid {}: {} names another grid. Leave one of the two names "
                                     "out",
                                     grid, text));
    return {file, own};
}

GridInput readGridInput(const std::string& text, const std::string& grid, Session& session)
{
    const GridPlace place = gridPlace(text, grid);
    const std::string& file = place.file;
    session.progress().beginStage("read");
    std::optional<LevelSetFile> there;
    readFile(file, ".vdb", [&](const std::filesystem::path& path) {
        there = readLevelSetFile(path, place.grid, session.bytesLeft());
    });
    for (const std::string& note : there->notes) session.warn(note);
    if (there->levelSet.halfWidth() < kLeastHalfWidth) {
        session.warn(
            fmt::format("{}: its band of {:.3g} voxels is too narrow to work with, and was "
                        "made {:g} wide",
                        file, there->levelSet.halfWidth(), kHalfWidth));
        there->levelSet = withHalfWidth(there->levelSet, kHalfWidth, &session.progress());
    }
    session.hold(there->levelSet.grid().memUsage());
    for (const auto& other : there->others) session.hold(other->memUsage());
    const Box3d box = Shape(there->levelSet).bounds();
    const double diagonal = box.isEmpty() ? 0 : box.diagonal().norm();
    return {file, std::move(there->levelSet), std::move(there->others), there->metadata, diagonal};
}

ExitCode writeGridOutput(const LevelSet& levelSet, const std::string& output,
                         const std::map<std::string, std::string>& metadata,
                         const openvdb::GridCPtrVec& beside, Session& session,
                         const openvdb::MetaMap& ofFile, double gradientTolerance)
{
    const CheckReport checked =
        check(levelSet.grid(), gradientTolerance, openvdb::CoordBBox::inf(), &session.progress());
    const auto write = [&](const std::filesystem::path& file) {
        writeLevelSet(file, levelSet, metadata, beside, ofFile, &session.progress());
    };
    if (output == "-")
        printFile(".vdb", write);
    else
        write(output);
    session.report()["grid"] = toJson(levelSet);
    session.report()["check"] = toJson(checked);
    const auto size = levelSet.grid().evalActiveVoxelDim();
    session.note(fmt::format("grid        voxel size {:.4g}, half-width {:.3g}, {} x {} x {}, {} "
                             "active voxels: {}",
                             levelSet.voxelSize(), levelSet.halfWidth(), size.x(), size.y(),
                             size.z(), levelSet.grid().activeVoxelCount(), output));
    if (levelSet.grid().activeVoxelCount() == 0)
        session.warn(fmt::format("{}: nothing is left: the level set is empty", output));
    for (const CheckFinding& finding : checked.findings)
        session.warn(fmt::format("{}: {}", output, findingText(finding)));
    return checked.sound() ? ExitCode::Ok : ExitCode::CheckFailed;
}

openvdb::GridCPtrVec besides(openvdb::GridCPtrVec others, const std::string& name, Session& session)
{
    const auto isSame = [&](const auto& grid) { return grid->getName() == name; };
    const auto end = std::remove_if(others.begin(), others.end(), isSame);
    if (end != others.end())
        session.warn(
            fmt::format("the file's own grid '{}' gives way to the one that is made", name));
    others.erase(end, others.end());
    return others;
}

void LevelSetVerb::addOptions(CLI::App& app)
{
    const Count count = inputCount();
    const char* const what = count.most == 1
                                 ? "A .vdb file with a level set; - is standard input"
                                 : "Files (.vdb) with a level set each; - is standard input;\n"
                                   "FILE.vdb:NAME names its grid";
    app.add_option("input", mInputs, what)
        ->required()
        ->expected(count.least, count.most ? count.most : CLI::detail::expected_max_vector_size)
        ->allow_extra_args(!count.most) // a word too many is said to be one
        ->type_name("IN.vdb");
    app.add_option("-o,--output", mOutput, "The level set; - is standard output")
        ->required()
        ->type_name("OUT.vdb");
    addGridName(app, mGrid);
    addOwnOptions(app);
}

openvdb::GridCPtrVec LevelSetVerb::gridsBeside(const LevelSet& made,
                                               const std::vector<GridInput>& inputs,
                                               Session& session) const
{
    return carriedGrids(made, inputs.front(), mWayBack, session);
}

ExitCode LevelSetVerb::run(Session& session)
{
    std::vector<std::string> files = otherInputs();
    for (const std::string& input : mInputs) files.push_back(gridPlace(input, mGrid).file);
    session.checkFiles({{"-o", mOutput, {".vdb"}, true}}, files);
    std::vector<GridInput> inputs;
    for (const std::string& file : mInputs) inputs.push_back(readGridInput(file, mGrid, session));
    session.progress().beginStage(text().name);
    const GridInput& first = inputs.front();
    const LevelSet made = inheriting(make(inputs, session), first.levelSet.grid());
    for (const std::string& note : session.progress().notes()) session.warn(note);
    session.report()["settings"] = mSettings;
    std::map<std::string, std::string> metadata = {{"mpuvdb:version", MPUVDB_VERSION},
                                                   {"mpuvdb:operation", text().name}};
    for (const auto& [key, value] : mSettings.items())
        metadata["mpuvdb:" + key] = value.is_string() ? value.get<std::string>() : value.dump();
    const ExitCode code = writeGridOutput(
        made, mOutput, metadata, gridsBeside(made, inputs, session), session, first.metadata);
    session.progress().endStage();
    session.note("time        " + session.timesText());
    return code;
}

void addSharedVoxelSize(CLI::App& app, std::optional<Length>& voxelSize)
{
    addLength(app, "--voxel-size", voxelSize,
              "Edge of the result's voxels; all inputs are resampled to them; vx means those of\n"
              "the finest input. Default: the finest input's, as long as that makes no more than\n"
              "64 times the voxels of all inputs");
}

namespace
{

/// World units; 0 if none was asked for.
double chosenVoxelSize(const std::vector<GridInput>& inputs, const std::optional<Length>& voxelSize)
{
    if (!voxelSize) return 0;
    double finest = inputs.front().levelSet.voxelSize(), largest = 0;
    for (const GridInput& input : inputs) {
        finest = std::min(finest, input.levelSet.voxelSize());
        largest = std::max(largest, input.diagonal);
    }
    const double chosen = voxelSize->resolve(finest, largest);
    if (!(chosen > 0))
        throw UsageError(fmt::format("--voxel-size {}: must be above 0", voxelSize->text()));
    return chosen;
}

/// Say what @a result takes where inputs are to be resampled, and refuse it where it is too much.
void sayBefore(const std::vector<GridInput>& inputs, const Shape& result, double voxelSize,
               Session& session)
{
    ShapeSettings wanted = settingsLike(inputs.front().levelSet, session);
    wanted.voxelSize = voxelSize > 0 ? voxelSize : result.voxelSize();
    bool resamples = false;
    for (const GridInput& input : inputs) {
        wanted.halfWidth = std::max(wanted.halfWidth, input.levelSet.halfWidth());
        resamples |= input.levelSet.voxelSize() != wanted.voxelSize;
    }
    if (!(voxelSize > 0)) result.requireFewVoxels(wanted);
    result.requireMemory(wanted);
    if (!resamples) return;
    const std::uint64_t voxels = result.plan(wanted).front().voxels,
                        bytes = result.peakBytes(wanted);
    session.report()["estimate"] = {
        {"voxel_size", wanted.voxelSize}, {"active_voxels", voxels}, {"peak_bytes", bytes}};
    session.note(fmt::format("estimate    {:.3g} million voxels of {:g}, {} of memory",
                             double(voxels) / 1e6, wanted.voxelSize, sizeText(bytes)));
}

} // namespace

std::vector<LevelSet> onOneLattice(const std::vector<GridInput>& inputs, const Shape& result,
                                   const std::optional<Length>& voxelSize, Json& settings,
                                   Session& session)
{
    const double chosen = chosenVoxelSize(inputs, voxelSize);
    sayBefore(inputs, result, chosen, session);
    if (chosen > 0) settings["voxel_size"] = chosen;
    const auto nameOf = [](const GridInput& input) {
        return fmt::format("{} (grid '{}', voxel size {:g})",
                           input.file == "-" ? "standard input" : input.file,
                           input.levelSet.grid().getName(), input.levelSet.voxelSize());
    };
    session.progress().beginStage("resample");
    std::vector<LevelSet> levelSets;
    levelSets.reserve(inputs.size());
    for (const GridInput& input : inputs) levelSets.push_back(input.levelSet);
    OneLattice shared = onOneLattice(levelSets, chosen, &session.progress());
    const std::string model = shared.model ? "the lattice of " + nameOf(inputs[*shared.model])
                                           : fmt::format("voxels of {:g}", chosen);
    for (const std::size_t n : shared.resampled) {
        const std::string note = fmt::format("{} was resampled to {}", nameOf(inputs[n]), model);
        session.note("resampled   " + note);
        settings["resampled"].push_back(note);
    }
    return std::move(shared.levelSets);
}

ShapeSettings settingsLike(const LevelSet& levelSet, const Session& session)
{
    ShapeSettings settings;
    settings.voxelSize = levelSet.voxelSize();
    settings.halfWidth = levelSet.halfWidth();
    settings.maxBytes = session.options().maxBytes;
    return settings;
}

ShapeSettings settingsLike(const std::vector<LevelSet>& levelSets, const Session& session)
{
    ShapeSettings settings = settingsLike(levelSets.front(), session);
    for (const LevelSet& levelSet : levelSets)
        settings.halfWidth = std::max(settings.halfWidth, levelSet.halfWidth());
    return settings;
}

std::vector<Shape> shapesOf(const std::vector<LevelSet>& levelSets)
{
    std::vector<Shape> shapes;
    shapes.reserve(levelSets.size());
    for (const LevelSet& levelSet : levelSets) shapes.emplace_back(levelSet);
    return shapes;
}

std::string lengthText(double length, double voxelSize)
{
    return fmt::format("{:.4g} ({:.3g} vx)", length, length / voxelSize);
}

Vec3d parseTriple(const std::string& option, const std::string& text)
{
    std::istringstream in(text);
    in.imbue(std::locale::classic());
    Vec3d triple;
    char first = 0, second = 0;
    in >> triple.x() >> first >> triple.y() >> second >> triple.z();
    if (!in || first != ',' || second != ',' || in.peek() != EOF || !triple.allFinite())
        throw UsageError(fmt::format("{}: '{}' is not three numbers. Write X,Y,Z", option, text));
    return triple;
}

CLI::Option* addDirection(CLI::App& app, const std::string& name, std::optional<Vec3d>& value,
                          const std::string& description)
{
    const auto parse = [name, &value](const std::string& text) {
        const bool isTurned = !text.empty() && text.front() == '-';
        const std::string axis = text.substr(isTurned);
        const std::size_t found = std::string_view("xyzXYZ").find(axis);
        if (axis.size() == 1 && found != std::string_view::npos) {
            value = Vec3d::Zero();
            (*value)[Eigen::Index(found % 3)] = isTurned ? -1 : 1;
        } else {
            value = parseTriple(name, text);
        }
    };
    return app.add_option_function<std::string>(name, parse, description)->type_name("x|y|z|X,Y,Z");
}

CLI::Option* addTriple(CLI::App& app, const std::string& name, std::optional<Vec3d>& value,
                       const std::string& description)
{
    const auto parse = [name, &value](const std::string& text) { value = parseTriple(name, text); };
    return app.add_option_function<std::string>(name, parse, description)->type_name("X,Y,Z");
}

} // namespace mpuvdb::command
