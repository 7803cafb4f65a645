// mpuvdb mesh: a level set to triangles.
#include "level_set_verb.h"
#include "standard_output.h"

#include <mpuvdb/given_level_set.h>
#include <mpuvdb/io.h>

#include <algorithm>
#include <filesystem>
#include <fmt/format.h>
#include <limits>

namespace mpuvdb::command
{
namespace
{

class MeshVerb final : public Verb
{
public:
    VerbText text() const override
    {
        return {"mesh", "A level set to triangles",
                "  mpuvdb mesh scan.vdb -o scan.obj\n"
                "  mpuvdb mesh scan.vdb -o - > scan.ply\n"
                "  mpuvdb mesh scan.vdb -o scan.glb --up z --units mm\n"
                "      For a world with Z up, in millimeters: GLB has Y up, and meters.\n"
                "  mpuvdb mesh part.vdb -o part.obj --tolerance 0.1vx --lods 3\n"
                "      A tenth of the triangles or fewer, and three coarser meshes.\n"
                "  mpuvdb mesh scan.vdb -o open.ply --holes 5vx\n"
                "      Holes of more than five voxels stay open; needs reconstruct --coverage.\n"};
    }

    void addOptions(CLI::App& app) override
    {
        app.add_option("input", mInput,
                       "A .vdb file with a level set, or FILE.vdb:NAME; - is standard input")
            ->required();
        app.add_option("-o,--output", mMesh.path,
                       "The mesh: .ply .obj .off .stl .glb .usda; - is PLY on standard output")
            ->required()
            ->type_name("OUT.ply");
        addGridName(app, mGrid);
        addHoles(app, mHoles);
        addAttributes(
            app, mAttributes,
            "Names of grids in the file with the vertices' colors and scalars; auto: Cd, if\n"
            "there is one; the default");
        addMeshShape(app, mMesh.shape, "--tolerance");
        addScene(app, mMesh.scene);
    }

    ExitCode run(Session& session) override
    {
        const GridPlace place = gridPlace(mInput, mGrid);
        const std::vector<Output> outputs = filesOf(mMesh, "-o");
        mMesh.scene.requireUse(outputs);
        session.checkFiles(outputs, {place.file});
        session.progress().beginStage("read");
        ExitCode code = ExitCode::Ok;
        readFile(place.file, ".vdb", [&](const std::filesystem::path& file) {
            code = meshFile(file, place.grid, session);
        });
        session.progress().endStage();
        session.note("time        " + session.timesText());
        return code;
    }

private:
    /// @param file  to read; temporary for standard input.
    ExitCode meshFile(const std::filesystem::path& file, const std::string& name, Session& session)
    {
        const LevelSet levelSet =
            readLevelSet(file, name, session.bytesLeft(), Validation::SignsOnly);
        session.hold(levelSet.grid().memUsage());
        const std::vector<openvdb::GridBase::Ptr> grids = attributeGrids(file, session.bytesLeft());
        for (const auto& grid : grids) session.hold(grid->memUsage());
        session.report()["grid"] = toJson(levelSet);
        if (!mHoles.close) {
            const double h = levelSet.voxelSize();
            const auto size = levelSet.grid().evalActiveVoxelDim();
            mMesh.trim = {readCoverage(file, session.bytesLeft()),
                          mHoles.closeUpTo.resolve(h, h * size.asVec3d().length())};
        }
        if (!grids.empty())
            mMesh.addAttributes = [&grids](Mesh& mesh, Interrupter& progress) {
                for (const auto& grid : grids) addAttribute(mesh, *grid, &progress);
            };
        const ExitCode code = writeMeshOf(levelSet, mMesh, session);
        const std::string missing = missingBand(levelSet, &session.progress());
        if (missing.empty()) return code;
        session.warn(missing + ". The mesh follows the signs: look at it, and see mpuvdb check");
        return ExitCode::CheckFailed;
    }

    /// The attributes' grids. @throws InputError where one that is named is missing.
    std::vector<openvdb::GridBase::Ptr> attributeGrids(const std::filesystem::path& file,
                                                       std::uint64_t maxBytes) const
    {
        const std::vector<std::string> names =
            mAttributes.automatic ? std::vector<std::string>{kColorName} : mAttributes.names;
        std::vector<openvdb::GridBase::Ptr> grids = readAttributeGrids(file, names, maxBytes);
        for (std::size_t n = 0; n < names.size() && !mAttributes.automatic; ++n)
            if (!grids[n])
                throw InputError(fmt::format("{}: has no float or Vec3f grid '{}'. List its grids "
                                             "with mpuvdb info",
                                             mInput, names[n]));
        grids.erase(std::remove(grids.begin(), grids.end(), nullptr), grids.end());
        return grids;
    }

    std::string mInput, mGrid;
    MeshOutput mMesh;
    Attributes mAttributes;
    Holes mHoles;
};

/// Trims the mesh, and reports its holes.
Mesh trimmed(Mesh mesh, const Trim& trim, Session& session)
{
    TrimReport report;
    const TrimSettings settings = trimSettings(*trim.coverage, trim.closeUpTo);
    mesh = trimMesh(std::move(mesh), *trim.coverage, settings, report, &session.progress());
    session.report()["holes"] = {{"open", report.open},
                                 {"closed", report.closed},
                                 {"islands_removed", report.islands},
                                 {"closed_up_to", settings.closeUpTo}};
    session.note(fmt::format("holes       {} open, {} of up to {:.4g} closed, {} islands in them "
                             "removed",
                             report.open, report.closed, settings.closeUpTo, report.islands));
    if (mesh.triangles.empty())
        session.warn("no part of the surface is covered: the trimmed mesh is empty");
    return mesh;
}

} // namespace

CLI::Option* addHoles(CLI::App& app, Holes& holes)
{
    return app
        .add_option_function<std::string>(
            "--holes",
            [&holes](const std::string& text) {
                holes.close = text == "close";
                if (holes.close || text == "open") return;
                holes.closeUpTo = Length::parse(text);
                if (!(holes.closeUpTo.value >= 0))
                    throw UsageError(
                        fmt::format("--holes: {} is below 0. Give close, open or a length", text));
            },
            "Holes of the mesh, where no data support the surface. close: closed, the default;\n"
            "open: the mesh is trimmed where coverage is below 1/2; a length: only uncovered\n"
            "patches that are longer than this are open")
        ->type_name("close|open|LENGTH");
}

namespace
{

/// Warns where STL's single precision moves vertices far from the origin.
void warnOfStl(const Mesh& mesh, double voxelSize, const std::string& output, Session& session)
{
    constexpr double kMinNotedError = 0.01; // voxels
    if (std::filesystem::path(output).extension() != ".stl") return;
    const double farthest = mesh.frame.cwiseAbs().maxCoeff();
    const double off = 0.5 * farthest * double(std::numeric_limits<float>::epsilon());
    if (off > kMinNotedError * voxelSize)
        session.warn(fmt::format("{}: STL holds single precision only, which moves vertices by up "
                                 "to {:.2g} ({:.2g} voxels) here. All other formats keep them",
                                 output, off, off / voxelSize));
}

} // namespace

void addScene(CLI::App& app, Scene& scene)
{
    const char* const group = "GLB and USD";
    addUpAxis(app, scene.settings.up,
              "The world's up axis: GLB is turned to Y up, USD stores it; default: y")
        ->each([&scene](const std::string&) { scene.given = "--up"; })
        ->group(group);
    static const std::map<std::string, double> units = {
        {"m", 1}, {"cm", 0.01}, {"mm", 0.001}, {"in", 0.0254}, {"ft", 0.3048}};
    app.add_option_function<std::string>(
           "--units",
           [&scene](const std::string& name) {
               scene.settings.metersPerUnit = units.at(name);
               scene.given = "--units";
           },
           "The world's unit: GLB is scaled to meters, USD stores it; default: m")
        ->type_name("m|cm|mm|in|ft")
        ->check(oneOf({"m", "cm", "mm", "in", "ft"}))
        ->group(group);
}

void Scene::requireUse(const std::vector<Output>& outputs) const
{
    const auto isStored = [](const Output& output) {
        const std::string format = extensionOf(output.path);
        return output.isFolder || format == ".glb" || format == ".usda";
    };
    if (!given.empty() && std::none_of(outputs.begin(), outputs.end(), isStored))
        throw UsageError(given + ": no output stores it. Write .glb or .usda, or leave it out; "
                                 "mpuvdb transform turns and scales the solid itself");
}

void addMeshShape(CLI::App& app, MeshShape& shape, const std::string& tolerance)
{
    const char* const group = "Triangles";
    app.add_option_function<std::string>(
           tolerance,
           [&shape, tolerance](const std::string& text) {
               shape.tolerance = Length::parse(text);
               if (!(shape.tolerance->value > 0))
                   throw UsageError(fmt::format("{} {}: must be above 0", tolerance, text));
           },
           "Fewer triangles, at most this far from the full mesh, such as 0.1vx: edges stay,\n"
           "colors too; default: all triangles")
        ->type_name("LENGTH")
        ->group(group);
    app.add_option(
           "--lods", shape.lods,
           "Write up to 8 coarser meshes too: OUT.lod1.ply, OUT.lod2.ply ..., each with four\n"
           "times the tolerance of the one before; the first with 0.4vx, or four times the\n"
           "tolerance given")
        ->type_name("N")
        ->check(CLI::Range(0, 8).description(""))
        ->group(group);
    app.add_flag("--strict", shape.strict,
                 "Retract vertices until no triangles cross; exit status 4 if some still do")
        ->group(group);
}

namespace
{

/// OUT.lod1.ply for OUT.ply.
std::string lodPath(const std::string& path, int level)
{
    std::filesystem::path file(path);
    const std::string extension = file.extension();
    file.replace_extension(fmt::format(".lod{}{}", level, extension));
    return file;
}

class MeshWriter
{
public:
    MeshWriter(double voxelSize, double tolerance, const MeshOutput& output, Session& session)
        : mVoxelSize(voxelSize), mTolerance(tolerance), mOutput(output), mSession(session)
    {
    }

    ExitCode write(Mesh mesh)
    {
        const MeshShape& shape = mOutput.shape;
        double within = mTolerance; // of the full mesh
        if (within > 0) mesh = simplify(mesh, {within, shape.strict}, &mSession.progress());
        mSession.report()["mesh"] = writeOne(mesh, mOutput.path, within);
        double next = within > 0 ? 4 * within : kFirstLod * mVoxelSize;
        for (int level = 1; level <= shape.lods; ++level, next *= 4) {
            mesh = simplify(mesh, {next - within, shape.strict}, &mSession.progress());
            within = next;
            const nlohmann::ordered_json lod = writeOne(mesh, lodPath(mOutput.path, level), within);
            mSession.report()["lods"].push_back(lod);
        }
        return mCrossing ? ExitCode::CheckFailed : ExitCode::Ok;
    }

private:
    static constexpr double kFirstLod = 0.4; // voxels

    nlohmann::ordered_json writeOne(const Mesh& mesh, const std::string& path, double within)
    {
        const auto toFile = [&](const std::filesystem::path& file) {
            writeMesh(file, mesh, mOutput.scene.settings, &mSession.progress());
        };
        if (path == "-")
            printFile(".ply", toFile);
        else
            toFile(path);
        warnOfStl(mesh, mVoxelSize, path, mSession);
        const MeshReport report = measure(mesh);
        nlohmann::ordered_json json = toJson(report);
        if (within > 0) json["tolerance"] = within;
        if (mOutput.shape.strict || !mSession.options().report.empty()) {
            const auto pairs = findSelfIntersections(mesh, &mSession.progress());
            json["self_intersections"] = pairs.size();
            if (mOutput.shape.strict && !pairs.empty()) {
                mCrossing = true;
                mSession.warn(fmt::format("{}: {} pairs of triangles cross; use smaller voxels, or "
                                          "a smaller tolerance",
                                          path, pairs.size()));
            }
        }
        mSession.note(fmt::format("mesh        {} vertices, {} triangles, {} components: {}",
                                  report.vertices, report.triangles, report.components, path));
        if ((report.boundaryEdges && !mOutput.trim.coverage) || report.nonManifoldEdges)
            mSession.warn(
                fmt::format("{}: the mesh is not closed: {} boundary and {} non-manifold edges",
                            path, report.boundaryEdges, report.nonManifoldEdges));
        return json;
    }

    double mVoxelSize, mTolerance;
    const MeshOutput& mOutput;
    Session& mSession;
    bool mCrossing = false;
};

/// Warn of attributes for which the format of @a path has no place.
void warnOfLost(const Mesh& mesh, const std::string& path, Session& session)
{
    const std::string format = extensionOf(path);
    const bool holdsScalars = format != ".obj" && format != ".off" && format != ".stl";
    std::vector<std::string> lost;
    if (!mesh.colors.empty() && format == ".stl") lost.push_back(kColorName);
    for (const NamedScalars& scalars : mesh.scalars)
        if (!holdsScalars) lost.push_back(scalars.name);
    if (!lost.empty())
        session.warn(fmt::format("{}: {} was left out, as {} files have no place for it. Write "
                                 ".ply, .glb or .usda",
                                 path, fmt::join(lost, ", "), format));
}

} // namespace

double toleranceOf(double voxelSize, double diagonal, const MeshShape& shape)
{
    if (!shape.tolerance || diagonal == 0) return 0;
    const double tolerance = shape.tolerance->resolve(voxelSize, diagonal);
    if (tolerance > diagonal / 2)
        throw UsageError(fmt::format("tolerance {:.4g}: is more than half of the diagonal of the "
                                     "solid's box, {:.4g}, so that nothing of its form would be "
                                     "left. Give a smaller one, such as 0.1vx",
                                     tolerance, diagonal));
    return tolerance;
}

double toleranceOf(const LevelSet& levelSet, const MeshShape& shape)
{
    if (levelSet.grid().empty()) return 0;
    const double h = levelSet.voxelSize();
    return toleranceOf(h, h * levelSet.grid().evalActiveVoxelDim().asVec3d().length(), shape);
}

std::vector<Output> filesOf(const MeshOutput& output, const std::string& option)
{
    std::vector<Output> files{{option, output.path, meshExtensions(), true}};
    if (output.path == "-" && output.shape.lods > 0)
        throw UsageError("--lods writes files beside the mesh. Name a file instead of -");
    for (int level = 1; level <= output.shape.lods && !output.path.empty(); ++level)
        files.push_back({"--lods", lodPath(output.path, level), meshExtensions()});
    return files;
}

ExitCode writeMeshes(Mesh mesh, double voxelSize, double tolerance, const MeshOutput& output,
                     Session& session)
{
    warnOfLost(mesh, output.path, session);
    if (mesh.triangles.empty())
        session.warn(fmt::format("{}: nothing is there: the mesh is empty", output.path));
    return MeshWriter(voxelSize, tolerance, output, session).write(std::move(mesh));
}

ExitCode writeMeshOf(const LevelSet& levelSet, const MeshOutput& output, Session& session)
{
    Mesh mesh = extractMesh(levelSet, {output.field, output.shape.strict}, &session.progress());
    if (output.trim.coverage) mesh = trimmed(std::move(mesh), output.trim, session);
    if (output.addAttributes) output.addAttributes(mesh, session.progress());
    return writeMeshes(std::move(mesh), levelSet.voxelSize(), toleranceOf(levelSet, output.shape),
                       output, session);
}

std::unique_ptr<Verb> makeMesh()
{
    return std::make_unique<MeshVerb>();
}

} // namespace mpuvdb::command
