// mpuvdb mesh: level set in, triangles out.
#include "describe.h"
#include "standard_output.h"
#include "verb.h"

#include <mpuvdb/io.h>

#include <fmt/format.h>

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
                "  mpuvdb mesh scan.vdb -o - > scan.ply\n"};
    }

    void addOptions(CLI::App& app) override
    {
        app.add_option("input", mInput, "A .vdb file with a level set")->required();
        app.add_option("-o,--output", mOutput,
                       "The mesh: .ply .obj .stl; - is PLY on standard output")
            ->required()
            ->type_name("OUT.ply");
        addGridName(app, mGrid);
    }

    ExitCode run(Session& session) override
    {
        session.checkFiles({{"-o", mOutput, {".ply", ".obj", ".stl"}, true}}, {mInput});
        session.progress().beginStage("read");
        const LevelSet levelSet = readLevelSet(mInput, mGrid);
        session.report()["grid"] = toJson(levelSet);
        writeMeshOf(levelSet, mOutput, session);
        session.progress().endStage();
        session.note("time        " + session.timesText());
        return ExitCode::Ok;
    }

private:
    std::string mInput, mOutput, mGrid;
};

} // namespace

void writeMeshOf(const LevelSet& levelSet, const std::string& output, Session& session)
{
    const Mesh mesh = extractMesh(levelSet, session.progress());
    const MeshReport report = measure(mesh);
    const auto write = [&](const std::filesystem::path& file) {
        writeMesh(file, mesh, session.progress());
    };
    if (output == "-")
        printFile(".ply", write);
    else
        write(output);
    session.report()["mesh"] = toJson(report);
    session.note(fmt::format("mesh        {} vertices, {} triangles, {} components: {}",
                             report.vertices, report.triangles, report.components, output));
    if (report.boundaryEdges || report.nonManifoldEdges) {
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
