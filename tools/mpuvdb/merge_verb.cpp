// mpuvdb merge: the grids of many files in one.
#include "describe.h"
#include "job_verbs.h"
#include "standard_output.h"
#include "verb.h"

#include <mpuvdb/farm.h>
#include <mpuvdb/io.h>

#include <algorithm>
#include <filesystem>
#include <fmt/format.h>
#include <set>

namespace mpuvdb::command
{
namespace
{

/// An input of merge: "FILE.vdb", or "NAME=FILE.vdb".
struct NamedFile {
    std::string file, name; ///< name: empty if there is none

    static NamedFile parse(const std::string& text)
    {
        const std::size_t equals = text.find('=');
        std::error_code ignored;
        // A folder's name may have the sign too, and so may a file's.
        const bool isName = equals != std::string::npos && equals > 0 && text.find('/') > equals &&
                            !std::filesystem::exists(text, ignored);
        return isName ? NamedFile{text.substr(equals + 1), text.substr(0, equals)}
                      : NamedFile{text, {}};
    }

    /// What a grid called @a grid is named after this file, which has @a count of them.
    std::string nameFor(const std::string& grid, std::size_t count) const
    {
        const std::string own = !name.empty() ? name
                                : file == "-" ? "input"
                                              : std::filesystem::path(file).stem().string();
        return count == 1 ? own : own + "_" + grid;
    }
};

class MergeVerb final : public Verb
{
public:
    VerbText text() const override
    {
        return {"merge", "The grids of many .vdb files, or the tiles of a job, in one file",
                "  mpuvdb merge surface.vdb density.vdb -o all.vdb\n"
                "  mpuvdb merge body=a.vdb arm=b.vdb -o both.vdb\n"
                "      The grid of a.vdb is called body, that of b.vdb arm.\n"
                "  mpuvdb merge job/ -o scan.vdb\n"
                "      The level set of a job that mpuvdb plan began.\n"
                "  mpuvdb merge job/ -o city/\n"
                "      A folder: a .vdb file for each tile, a USD layer that shows them as one,\n"
                "      level sets of voxels 4 and 16 times larger, and an index (JSON).\n"
                "  mpuvdb merge job/ --mesh city.ply\n"
                "      The mesh of the whole, made tile by tile.\n"
                "  mpuvdb merge job/ --mesh city.ply --mesh-tolerance 0.1vx --lods 3\n"
                "      A tenth of the triangles or fewer, and three coarser meshes.\n"};
    }

    void addOptions(CLI::App& app) override
    {
        app.add_option("input", mInputs,
                       "Files (.vdb); NAME=FILE.vdb names the file's grid, or of several each\n"
                       "NAME_GRID. Of grids with equal names the later ones are called as their\n"
                       "file, or FILE_GRID; in one file they are numbered: GRID, GRID_2. - is\n"
                       "standard input. Or the folder of one job")
            ->required()
            ->type_name("[NAME=]IN.vdb");
        app.add_option("-o,--output", mOutput,
                       "All grids; - is standard output. Of a job also a folder, whose name ends\n"
                       "in /; a name without an extension is that of a folder where the grids\n"
                       "take more than 4 GiB, and else gets .vdb")
            ->type_name("OUT.vdb|OUT/");
        CLI::Option* const mesh =
            app.add_option(
                   "--mesh", mMesh.path,
                   "Of a job: write the mesh of mpuvdb reconstruct, tile by tile: .ply .obj\n"
                   ".off .stl .glb .usda; - is PLY on standard output")
                ->type_name("OUT.ply");
        addMeshShape(app, mMesh.shape, "--mesh-tolerance");
        for (const char* const ofMesh : {"--mesh-tolerance", "--lods", "--strict"})
            app.get_option(ofMesh)->needs(mesh);
        addScene(app, mMesh.scene);
        app.callback([this] {
            const bool isOfJob = mInputs.size() == 1 && isJob(mInputs[0]);
            if (!mMesh.path.empty() && !isOfJob)
                throw UsageError("--mesh is for jobs: mpuvdb mesh makes one of a .vdb file");
            if (mOutput.empty() && mMesh.path.empty()) throw CLI::RequiredError("--output");
        });
    }

    ExitCode run(Session& session) override
    {
        if (mInputs.size() == 1 && isJob(mInputs[0])) return mergeJob(session);
        std::vector<NamedFile> inputs;
        std::vector<std::string> files;
        for (const std::string& text : mInputs) {
            inputs.push_back(NamedFile::parse(text));
            files.push_back(inputs.back().file);
        }
        const std::vector<Output> outputs{{"-o", mOutput, {".vdb"}, true}};
        mMesh.scene.requireUse(outputs);
        session.checkFiles(outputs, files);
        for (const NamedFile& input : inputs) add(input, session);
        openvdb::GridCPtrVec grids(mGrids.begin(), mGrids.end());
        const auto write = [&](const std::filesystem::path& file) {
            writeGrids(file, grids, mMetadata, &session.progress());
        };
        if (mOutput == "-")
            printFile(".vdb", write);
        else
            write(mOutput);
        session.report()["grids"] = mList;
        session.progress().endStage();
        session.note(fmt::format("grids       {}: {}", grids.size(), mOutput));
        session.note("time        " + session.timesText());
        return ExitCode::Ok;
    }

private:
    static bool isJob(const std::string& input)
    {
        std::error_code ignored;
        return std::filesystem::is_directory(input, ignored);
    }

    /// Whether the result of @a job is a folder. @param output  gets its extension, if it has none.
    static bool isFolder(const Job& job, std::string& output)
    {
        /// Bytes from which on a grid is many files. [derived: sizes of 32 bits, at which file
        /// systems, archives and formats of pictures and scenes end]
        constexpr std::uint64_t kLargestFile = std::uint64_t(1) << 32;
        const std::filesystem::path path(output);
        std::error_code ignored;
        if (path.filename().empty() || std::filesystem::is_directory(path, ignored)) return true;
        if (path.has_extension()) return false;
        if (job.bytes() > kLargestFile) return true;
        output += ".vdb";
        return false;
    }

    ExitCode mergeJob(Session& session) const
    {
        const Job job(mInputs[0], buildId());
        std::string output = mOutput;
        const bool asFolder = !output.empty() && isFolder(job, output);
        std::vector<Output> outputs = filesOf(mMesh, "--mesh");
        outputs.push_back({"-o", output, {".vdb"}, false, false, asFolder});
        mMesh.scene.requireUse(outputs);
        std::vector<std::string> inputs = job.inputs();
        inputs.push_back(mInputs[0]);
        session.checkFiles(outputs, inputs);
        session.openScratch(mInputs[0]);
        Interrupter* const interrupter = &session.progress();
        // Refused before anything is written.
        const double tolerance =
            mMesh.shape.tolerance
                ? toleranceOf(job.voxelSize(), job.diagonal(interrupter), mMesh.shape)
                : 0;
        ExitCode code = ExitCode::Ok;
        if (asFolder)
            code = describeJob(
                session, job.mergeToFolder(output, mMesh.scene.settings, interrupter), output);
        else if (!output.empty())
            code = describeJob(session, job.merge(output, interrupter), output);
        if (mMesh.path.empty()) return code;
        const ExitCode meshCode = writeMesh(job, tolerance, session);
        return code == ExitCode::Ok ? meshCode : code;
    }

    ExitCode writeMesh(const Job& job, double tolerance, Session& session) const
    {
        Mesh mesh = job.mesh(session.bytesLeft(), mMesh.shape.strict, &session.progress());
        const ExitCode code =
            writeMeshes(std::move(mesh), job.voxelSize(), tolerance, mMesh, session);
        session.progress().endStage();
        session.note("time        " + session.timesText());
        return code;
    }

    void add(const NamedFile& input, Session& session)
    {
        session.progress().beginStage("read");
        openvdb::GridPtrVec grids;
        readFile(input.file, ".vdb", [&](const std::filesystem::path& path) {
            grids = readGrids(path, session.bytesLeft(), &session.progress());
            openvdb::MetaMap metadata = readFileMetadata(path);
            metadata.insertMeta(mMetadata); // earlier files' stay
            mMetadata = metadata;
        });
        const std::vector<std::string> names = distinctNames(grids);
        for (std::size_t n = 0; n < grids.size(); ++n) {
            const openvdb::GridBase::Ptr& grid = grids[n];
            session.hold(grid->memUsage());
            const std::string own = grid->getName(),
                              longName = input.nameFor(names[n], grids.size());
            std::string name = input.name.empty() ? names[n] : longName;
            if (isTaken(name)) name = longName;
            if (name.empty() || isTaken(name))
                throw UsageError(fmt::format("{}: its grid '{}' cannot be called '{}', as another "
                                             "one is. Write NAME={}",
                                             input.file, own, name, input.file));
            if (name != own)
                session.note(fmt::format("renamed     '{}' of {}: '{}'", own, input.file, name));
            grid->setName(name);
            mList.push_back({{"name", name}, {"file", input.file}, {"was", own}});
            mGrids.push_back(grid);
        }
    }

    /// The names of @a grids, all of one file; repeats are numbered from 2 on, as no other is.
    static std::vector<std::string> distinctNames(const openvdb::GridPtrVec& grids)
    {
        std::set<std::string> own, given;
        for (const openvdb::GridBase::Ptr& grid : grids) own.insert(grid->getName());
        std::vector<std::string> names;
        for (const openvdb::GridBase::Ptr& grid : grids) {
            std::string name = grid->getName();
            for (int number = 2; given.count(name) > 0; ++number) {
                const std::string next = fmt::format("{}_{}", grid->getName(), number);
                if (own.count(next) == 0) name = next;
            }
            given.insert(name);
            names.push_back(std::move(name));
        }
        return names;
    }

    bool isTaken(const std::string& name) const
    {
        return std::any_of(mGrids.begin(), mGrids.end(),
                           [&](const auto& grid) { return grid->getName() == name; });
    }

    std::vector<std::string> mInputs;
    std::string mOutput;
    MeshOutput mMesh;
    openvdb::GridPtrVec mGrids;
    openvdb::MetaMap mMetadata; ///< of the files themselves
    Json mList = Json::array();
};

} // namespace

std::unique_ptr<Verb> makeMerge()
{
    return std::make_unique<MergeVerb>();
}

} // namespace mpuvdb::command
