// mpuvdb reconstruct: points in, level set (and mesh) out.
#include "cloud_options.h"
#include "describe.h"
#include "job_verbs.h"
#include "level_set_verb.h"
#include "memory_limit.h"
#include "presets.h"
#include "verb.h"

#include <mpuvdb/error.h>
#include <mpuvdb/explained.h>
#include <mpuvdb/io.h>
#include <mpuvdb/reconstruct.h>

#include <algorithm>
#include <fmt/format.h>

namespace mpuvdb::command
{
namespace
{

class Reconstruct final : public Verb
{
public:
    VerbText text() const override
    {
        return {"reconstruct", "Points (one or more files) to a level set, and a mesh if wanted",
                "  mpuvdb reconstruct scan.ply -o scan.vdb\n"
                "      Voxel size and tolerance follow from the spacing and noise of the points.\n"
                "  mpuvdb reconstruct bun.conf -o bunny.vdb --voxels 256 --mesh bunny.ply\n"
                "      A Stanford scan set, 256 voxels along its longest side, and a mesh beside.\n"
                "  mpuvdb reconstruct scan.ply --voxels 2000 --dry-run\n"
                "      What that would take: settings, voxels, memory, size of the file.\n"
                "  cat scan.ply | mpuvdb reconstruct - -o scan.vdb --report scan.json\n"
                "      Points from standard input; settings, results and times as JSON.\n"};
    }

    void addOptions(CLI::App& app) override
    {
        mCloud.addInputs(app);
        app.add_option("-o,--output", mOutput, "The level set")->type_name("OUT.vdb");
        CLI::Option* const mesh =
            app.add_option("--mesh", mMesh.path,
                           "Write a mesh too: .ply .obj .off .stl .glb .usda; - is PLY on "
                           "standard\noutput")
                ->type_name("OUT.ply");
        app.add_option("--usd", mUsd,
                       "Write a USD layer too, whose volume refers to the level set's file; with\n"
                       "--frames one layer with time samples, or one for each in name.####.usda")
            ->type_name("OUT.usda");
        addPreset(app, mCloud.preset);
        app.add_flag("--dry-run", mDryRun,
                     "Read the points, say what the settings come to and what the run would take:\n"
                     "voxels, memory (to a fifth), size of the file. Writes nothing but a report");
        app.callback([this, &app] {
            if (mOutput.empty() && !mDryRun) throw CLI::RequiredError("--output");
            if (mCloud.options.region && (!mMesh.path.empty() || wantsCoverage()))
                throw UsageError("--region ends the band at its sides: there is no --mesh, "
                                 "--coverage or --holes of a part");
            mPresetOptions = applyPreset(app, mCloud.preset);
        });
        addAttributes(app, mCloud.attributes,
                      "What of the points goes to grids beside the level set and to the mesh: Cd\n"
                      "(colors, linear in the grid), confidence, and properties of the files by\n"
                      "name (PLY, PCD, columns with names, intensity of LAS). auto: Cd, where the\n"
                      "points have colors; the default");
        addHoleOptions(app);
        mCloud.addTo(app);
        addRegion(app);
        addMeshShape(app, mMesh.shape, "--mesh-tolerance");
        for (const char* const ofMesh : {"--mesh-tolerance", "--lods", "--strict"})
            app.get_option(ofMesh)->needs(mesh);
        addScene(app, mMesh.scene);
    }

    ExitCode run(Session& session) override
    {
        if (!mCloud.preset.empty())
            session.note(fmt::format("preset      {}: {}", mCloud.preset, mPresetOptions));
        const std::uint64_t bareBytes = residentBytes();
        std::vector<Output> outputs = filesOf(mMesh, "--mesh");
        outputs.push_back({"--usd", mUsd, {".usda"}, false, /*joinsFrames=*/true});
        if (!mOutput.empty()) outputs.push_back({"-o", mOutput, {".vdb"}});
        mMesh.scene.requireUse(outputs);
        session.checkFiles(outputs, mCloud.inputs);
        if (!mDryRun) session.openScratch(mOutput);
        Interrupter* const interrupter = &session.progress();
        PreparedPoints prepared = preparePoints(mCloud.read(session), mCloud.options, interrupter);
        mCloud.describeCleaning(session, prepared.report);
        if (mDryRun) {
            foresee(session, prepared, bareBytes);
            return ExitCode::Ok;
        }
        if (!mayBeInTasks()) {
            requireMemory(prepared, !mMesh.path.empty(), bareBytes, interrupter);
        } else if (const auto beyond = beyondMemory(prepared, false, bareBytes, interrupter)) {
            mCloud.describeSettings(session, prepared.report);
            CloudOptions::summarizeSettings(session, prepared.report);
            const auto metadata = metadataOf(prepared.report);
            return reconstructInTasks(session, std::move(prepared), *beyond, metadata, mOutput);
        }
        FittedPoints fitted = fitPoints(std::move(prepared), interrupter);
        // Their grids are only written: they need no voxels in memory.
        const std::vector<std::string> attributes = std::move(fitted.options.attributes);
        fitted.options.attributes.clear();
        ReconstructResult made = sampleFit(fitted, interrupter);
        toleranceOf(made.levelSet(), mMesh.shape); // refused before anything is written
        openvdb::GridCPtrVec beside;
        if (made.coverage) beside.push_back(made.coverage);
        if (!attributes.empty())
            for (const auto& grid :
                 compressAttributes(made.levelSet(),
                                    *made.field->attributes(attributes, interrupter), interrupter))
                beside.push_back(grid);
        describe(session, made);
        const CheckReport checked = checkOf(made, session);
        session.report()["check"] = toJson(checked);
        writeGrids(session, made, std::move(beside));
        ExitCode meshCode = ExitCode::Ok;
        if (!mMesh.path.empty()) meshCode = writeMesh(session, made);
        session.progress().endStage();
        summarize(session, made);
        const PointsExplained& explained = made.report.explained;
        session.note("explained   " + explainedText(explained));
        if (made.grid->activeVoxelCount() == 0)
            session.warn(fmt::format("{}: nothing is there: the surface does not reach the region",
                                     mOutput));
        for (const CheckFinding& finding : checked.findings)
            session.warn(fmt::format("{}: {}", mOutput, findingText(finding)));
        for (const std::string& finding : explained.findings)
            session.warn(fmt::format("{}: {}", mOutput, finding));
        return checked.sound() && explained.findings.empty() ? meshCode : ExitCode::CheckFailed;
    }

    /// Writes the USD layer of a sequence.
    void joinFrames(const std::vector<FrameFiles>& frames) const override
    {
        std::vector<VolumeFrame> volumes;
        for (const FrameFiles& frame : frames)
            for (const Output& output : frame.outputs)
                if (output.option == "-o") volumes.push_back({frame.frame, output.path});
        writeVolumeLayer(mUsd, volumes, mMesh.scene.settings);
    }

private:
    /// Whether tasks make all that is asked for.
    bool mayBeInTasks() const
    {
        return mMesh.path.empty() && mUsd.empty() && !mCloud.options.region;
    }

    void addRegion(CLI::App& app)
    {
        app.add_option_function<std::vector<std::string>>(
               "--region", [this](const std::vector<std::string>& words) { setRegion(words); },
               "Only the voxels in this box (X0 Y0 Z0 X1 Y1 Z1), active and with values as\n"
               "without it. Outside of it nothing is active: the band ends at its sides (check\n"
               "finds that), and there may be no mesh. All points are read and fitted")
            ->type_name("LENGTH")
            ->expected(6)
            ->group("Grid");
    }

    void setRegion(const std::vector<std::string>& words)
    {
        mCloud.options.region.emplace();
        std::transform(words.begin(), words.end(), mCloud.options.region->begin(),
                       [](const std::string& word) { return Length::parse(word); });
    }

    void addHoleOptions(CLI::App& app)
    {
        const char* const group = "Holes";
        addHoles(app, mCloud.holes)->group(group);
        app.add_flag(
               "--coverage", mCloud.coverage,
               "Write a grid 'coverage' beside the level set: 1 where data support the\n"
               "surface, 0 where it is invented. --holes implies it, unless it is close; the\n"
               "level set itself is always closed")
            ->group(group);
    }

    static CheckReport checkOf(const ReconstructResult& made, Session& session)
    {
        const SampleSettings& s = made.report.settings.grid;
        const openvdb::CoordBBox within =
            s.region ? voxelsIn(*s.region, s.lattice) : openvdb::CoordBBox::inf();
        return check(*made.grid, kGradientTolerance, within, &session.progress());
    }

    bool wantsCoverage() const { return mCloud.coverage || !mCloud.holes.close; }

    void writeGrids(Session& session, const ReconstructResult& made,
                    openvdb::GridCPtrVec&& beside) const
    {
        writeLevelSet(mOutput, made.levelSet(), metadataOf(made.report), beside,
                      &session.progress());
        if (mUsd.empty() || session.isShared("--usd")) return;
        beside.insert(beside.begin(), made.grid);
        writeVolumeLayer(mUsd, mOutput, beside, mMesh.scene.settings);
    }

    /// Attributes come to the mesh from the field itself.
    ExitCode writeMesh(Session& session, const ReconstructResult& made)
    {
        mMesh.field = made.field.get();
        if (!mCloud.options.attributes.empty())
            mMesh.addAttributes =
                [attributes = std::shared_ptr<const SurfaceAttributes>(
                     made.field->attributes(mCloud.options.attributes, &session.progress()))](
                    Mesh& mesh, Interrupter& progress) {
                    addAttributes(mesh, *attributes, &progress);
                };
        const ResolvedSettings& s = made.report.settings;
        if (!mCloud.holes.close)
            mMesh.trim = {made.coverage,
                          mCloud.holes.closeUpTo.resolve(s.grid.lattice.voxelSize, s.diagonal)};
        return writeMeshOf(made.levelSet(), mMesh, session);
    }

    void foresee(Session& session, const PreparedPoints& points, std::uint64_t bareBytes) const
    {
        const bool withMesh = !mMesh.path.empty();
        const ReconstructionEstimate run = estimate(points, withMesh, &session.progress());
        const std::uint64_t peakBytes = bareBytes + run.peakBytes;
        const ResolvedSettings& s = run.settings;
        mCloud.describeSettings(session, points.report);
        Json& report = session.report()["estimate"];
        report = {{"area", run.area},
                  {"leaves", run.fit.leaves},
                  {"active_voxels", run.activeVoxels},
                  {"field_bytes", run.fit.bytes},
                  {"grid_bytes", run.gridBytes},
                  {"file_bytes", run.fileBytes},
                  {"peak_bytes", peakBytes}};
        if (withMesh) report["triangles"] = run.triangles;
        CloudOptions::summarizeSettings(session, points.report);
        const double h = s.grid.lattice.voxelSize;
        const Vec3d size = (s.boxSize / h).array() + 2 * s.grid.halfWidth;
        session.note(fmt::format("grid        voxel size {:.4g}, half-width {}, about {:.0f} x "
                                 "{:.0f} x {:.0f}, {:.3g} active voxels",
                                 h, s.grid.halfWidth, size.x(), size.y(), size.z(),
                                 double(run.activeVoxels)));
        session.note(fmt::format("would take  about {} of memory (limit {}), {} on disk",
                                 sizeText(peakBytes), sizeText(*mCloud.options.maxBytes),
                                 sizeText(run.fileBytes)));
        session.progress().endStage();
    }

    void describe(Session& session, const ReconstructResult& made) const
    {
        mCloud.describeSettings(session, made.report);
        const MpuStatistics& fit = made.report.fit;
        Json& report = session.report();
        report["field"] = {{"cells", fit.cells},
                           {"leaves", fit.leaves},
                           {"levels", fit.levels},
                           {"fits", fit.fits},
                           {"sharp_fits", fit.sharpFits},
                           {"max_error", fit.maxError},
                           {"over_tolerance", fit.overTolerance},
                           {"bytes", fit.bytes}};
        report["explained"] = toJson(made.report.explained);
        report["grid"] = toJson(made.levelSet());
        if (made.coverage)
            report["coverage"] = {{"name", made.coverage->getName()},
                                  {"spacing", *made.report.coverageSpacing},
                                  {"active_voxels", made.coverage->activeVoxelCount()},
                                  {"bytes", made.coverage->memUsage()}};
    }

    void summarize(Session& session, const ReconstructResult& made) const
    {
        const ResolvedSettings& s = made.report.settings;
        CloudOptions::summarizeSettings(session, made.report);
        const auto size = made.grid->evalActiveVoxelDim();
        session.note(fmt::format("grid        voxel size {:.4g}, half-width {}, {} x {} x {}, {} "
                                 "active voxels: {}",
                                 s.grid.lattice.voxelSize, s.grid.halfWidth, size.x(), size.y(),
                                 size.z(), made.grid->activeVoxelCount(), mOutput));
        session.note("time        " + session.timesText());
    }

    CloudOptions mCloud;
    std::string mOutput, mUsd;
    MeshOutput mMesh;
    std::string mPresetOptions; ///< what the preset set
    bool mDryRun = false;
};

} // namespace

std::unique_ptr<Verb> makeReconstruct()
{
    return std::make_unique<Reconstruct>();
}

} // namespace mpuvdb::command
