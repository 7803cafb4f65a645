// mpuvdb mesh: level set in, triangles out.
#include "describe.h"
#include "standard_output.h"
#include "verb.h"

#include <mpuvdb/io.h>

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
                "  mpuvdb mesh scan.vdb -o open.ply --holes 5vx\n"
                "      Holes of more than five voxels stay open; needs reconstruct --coverage.\n"};
    }

    void addOptions(CLI::App& app) override
    {
        app.add_option("input", mInput, "A .vdb file with a level set")->required();
        app.add_option("-o,--output", mOutput,
                       "The mesh: .ply .obj .stl; - is PLY on standard output")
            ->required()
            ->type_name("OUT.ply");
        addGridName(app, mGrid);
        addHoles(app, mHoles);
    }

    ExitCode run(Session& session) override
    {
        session.checkFiles({{"-o", mOutput, {".ply", ".obj", ".stl"}, true}}, {mInput});
        session.progress().beginStage("read");
        const LevelSet levelSet = readLevelSet(mInput, mGrid);
        session.report()["grid"] = toJson(levelSet);
        Trim trim;
        if (!mHoles.close) {
            const double h = levelSet.voxelSize();
            const auto size = levelSet.grid().evalActiveVoxelDim();
            trim = {readCoverage(mInput), mHoles.closeUpTo.resolve(h, h * size.asVec3d().length())};
        }
        writeMeshOf(levelSet, trim, mOutput, session);
        session.progress().endStage();
        session.note("time        " + session.timesText());
        return ExitCode::Ok;
    }

private:
    std::string mInput, mOutput, mGrid;
    Holes mHoles;
};

/// Trim, and say what became of the holes.
Mesh trimmed(Mesh mesh, const Trim& trim, Session& session)
{
    TrimReport report;
    const TrimSettings settings = trimSettings(*trim.coverage, trim.closeUpTo);
    mesh = trimMesh(std::move(mesh), *trim.coverage, settings, report, session.progress());
    session.report()["holes"] = {{"open", report.open},
                                 {"closed", report.closed},
                                 {"islands_removed", report.islands},
                                 {"closed_up_to", settings.closeUpTo}};
    session.note(fmt::format("holes       {} open, {} of up to {:.4g} closed, {} islands in them "
                             "removed",
                             report.open, report.closed, settings.closeUpTo, report.islands));
    if (mesh.triangles.empty())
        session.warn("nothing of the surface is covered: the trimmed mesh is empty");
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
                        fmt::format("--holes: {} is below 0: say close, open or a size", text));
            },
            "Of the mesh, where no data support the surface. close: closed, the default;\n"
            "open: the mesh is trimmed where coverage is below 1/2; a length: only where the\n"
            "uncovered patch is larger than that from end to end")
        ->type_name("close|open|LENGTH");
}

namespace
{

/// STL has single precision: far from the origin vertices cannot stay where they are.
void warnOfStl(const Mesh& mesh, double voxelSize, const std::string& output, Session& session)
{
    constexpr double kNoticed = 0.01; // voxels
    if (std::filesystem::path(output).extension() != ".stl") return;
    const double farthest = mesh.frame.cwiseAbs().maxCoeff();
    const double off = 0.5 * farthest * double(std::numeric_limits<float>::epsilon());
    if (off > kNoticed * voxelSize)
        session.warn(fmt::format("{}: STL holds single precision only, which moves vertices by up "
                                 "to {:.2g} ({:.2g} voxels) here; .ply and .obj keep them",
                                 output, off, off / voxelSize));
}

} // namespace

void writeMeshOf(const LevelSet& levelSet, const Trim& trim, const std::string& output,
                 Session& session)
{
    Mesh mesh = extractMesh(levelSet, session.progress());
    if (trim.coverage) mesh = trimmed(std::move(mesh), trim, session);
    const MeshReport report = measure(mesh);
    const auto write = [&](const std::filesystem::path& file) {
        writeMesh(file, mesh, session.progress());
    };
    if (output == "-")
        printFile(".ply", write);
    else
        write(output);
    warnOfStl(mesh, levelSet.voxelSize(), output, session);
    session.report()["mesh"] = toJson(report);
    session.note(fmt::format("mesh        {} vertices, {} triangles, {} components: {}",
                             report.vertices, report.triangles, report.components, output));
    if ((report.boundaryEdges && !trim.coverage) || report.nonManifoldEdges) {
        session.warn(
            fmt::format("{}: the mesh is not closed: {} boundary and {} non-manifold edges", output,
                        report.boundaryEdges, report.nonManifoldEdges));
    }
}

std::unique_ptr<Verb> makeMesh()
{
    return std::make_unique<MeshVerb>();
}

} // namespace mpuvdb::command
