// mpuvdb reconstruct: points in, level set (and mesh) out.
#include "describe.h"
#include "level_set_verb.h"
#include "memory_limit.h"
#include "presets.h"
#include "verb.h"

#include <mpuvdb/clean.h>
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
        app.add_option(
               "input", mInputs,
               "Points: .ply .conf .xyz .pts .pwn .txt .ptx .obj .off .stl .pcd .las; - is\n"
               "standard input. Several are joined.")
            ->required();
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
        addPreset(app, mPreset);
        app.add_flag("--dry-run", mDryRun,
                     "Read the points, say what the settings come to and what the run would take:\n"
                     "voxels, memory (to a fifth), size of the file. Writes nothing but a report");
        app.callback([this, &app] {
            if (mOutput.empty() && !mDryRun) throw CLI::RequiredError("--output");
            if (mOptions.region && (!mMesh.path.empty() || wantsCoverage()))
                throw UsageError("--region ends the band at its sides: there is no --mesh, "
                                 "--coverage or --holes of a part");
            mPresetOptions = applyPreset(app, mPreset);
        });
        addAttributes(app, mAttributes,
                      "What of the points goes to grids beside the level set and to the mesh: Cd\n"
                      "(colors, linear in the grid), confidence, and properties of the files by\n"
                      "name (PLY, PCD, columns with names, intensity of LAS). auto: Cd, where the\n"
                      "points have colors; the default");
        addHoleOptions(app);
        addGridOptions(app);
        addFitOptions(app);
        addPointOptions(app);
        addMeshShape(app, mMesh.shape, "--mesh-tolerance");
        for (const char* const ofMesh : {"--mesh-tolerance", "--lods", "--strict"})
            app.get_option(ofMesh)->needs(mesh);
        addScene(app, mMesh.scene);
    }

    ExitCode run(Session& session) override
    {
        if (!mPreset.empty())
            session.note(fmt::format("preset      {}: {}", mPreset, mPresetOptions));
        const std::uint64_t bareBytes = residentBytes();
        std::vector<Output> outputs = filesOf(mMesh, "--mesh");
        outputs.push_back({"--usd", mUsd, {".usda"}, false, /*joinsFrames=*/true});
        if (!mOutput.empty()) outputs.push_back({"-o", mOutput, {".vdb"}});
        session.checkFiles(outputs, mInputs);
        Interrupter* const interrupter = &session.progress();
        PreparedPoints prepared = preparePoints(readInput(session), mOptions, interrupter);
        describeCleaning(session, prepared.report);
        if (mDryRun) {
            foresee(session, prepared, bareBytes);
            return ExitCode::Ok;
        }
        requireMemory(prepared, !mMesh.path.empty(), bareBytes, interrupter);
        ReconstructResult made =
            sampleFit(fitPoints(std::move(prepared), interrupter), interrupter);
        describe(session, made);
        const CheckReport checked = checkOf(made, session);
        session.report()["check"] = toJson(checked);
        writeGrids(session, made);
        ExitCode meshCode = ExitCode::Ok;
        if (!mMesh.path.empty()) meshCode = writeMesh(session, made);
        session.progress().endStage();
        summarize(session, made);
        const PointsExplained& explained = made.report.explained;
        session.note("explained   " + explainedText(explained));
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
        writeVolumeLayer(mUsd, volumes, mMesh.scene);
    }

private:
    void addHoleOptions(CLI::App& app)
    {
        const char* const group = "Holes";
        addHoles(app, mHoles)->group(group);
        app.add_flag(
               "--coverage", mCoverage,
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

    bool wantsCoverage() const { return mCoverage || !mHoles.close; }

    void writeGrids(Session& session, const ReconstructResult& made) const
    {
        openvdb::GridCPtrVec beside(made.attributes.begin(), made.attributes.end());
        if (made.coverage) beside.insert(beside.begin(), made.coverage);
        writeLevelSet(mOutput, made.levelSet(), metadata(made), beside, &session.progress());
        if (mUsd.empty() || session.isShared("--usd")) return;
        beside.insert(beside.begin(), made.grid);
        writeVolumeLayer(mUsd, mOutput, beside, mMesh.scene);
    }

    /// Attributes come to the mesh from the field itself.
    ExitCode writeMesh(Session& session, const ReconstructResult& made)
    {
        mMesh.field = made.field.get();
        if (!mOptions.attributes.empty())
            mMesh.addAttributes = [attributes = std::shared_ptr<const SurfaceAttributes>(
                                       made.field->attributes(mOptions.attributes))](
                                      Mesh& mesh, Interrupter& progress) {
                addAttributes(mesh, *attributes, &progress);
            };
        const ResolvedSettings& s = made.report.settings;
        if (!mHoles.close)
            mMesh.trim = {made.coverage,
                          mHoles.closeUpTo.resolve(s.grid.lattice.voxelSize, s.diagonal)};
        return writeMeshOf(made.levelSet(), mMesh, session);
    }

    void addGridOptions(CLI::App& app)
    {
        const char* const group = "Grid";
        CLI::Option* const size =
            addLength(app, "--voxel-size", mOptions.voxelSize,
                      "Edge of a voxel; default: the measured spacing of the points")
                ->group(group);
        app.add_option("--voxels", mOptions.voxels,
                       "Instead: voxels along the longest side of the points' box")
            ->type_name("N")
            ->excludes(size)
            ->group(group);
        app.add_option_function<std::vector<std::string>>(
               "--region", [this](const std::vector<std::string>& words) { setRegion(words); },
               "Only the voxels in this box (X0 Y0 Z0 X1 Y1 Z1), active and with values as\n"
               "without it, but where islands, handles or jumps that are closed reach from it\n"
               "farther than 32 voxels, or where the whole is so noisy that all distances are\n"
               "made anew. Outside of it nothing is active: the band ends at its sides (check\n"
               "finds that), and there may be no mesh. All points are read and fitted")
            ->type_name("LENGTH")
            ->expected(6)
            ->group(group);
        app.add_option("--half-width", mOptions.halfWidth,
                       "Voxels of the narrow band on either side of the surface")
            ->type_name("VOXELS")
            ->capture_default_str()
            ->group(group);
    }

    void setRegion(const std::vector<std::string>& words)
    {
        mOptions.region.emplace();
        std::transform(words.begin(), words.end(), mOptions.region->begin(),
                       [](const std::string& word) { return Length::parse(word); });
    }

    void addFitOptions(CLI::App& app)
    {
        const char* const group = "Fit";
        addLength(app, "--tolerance", mOptions.tolerance,
                  "Largest distance of a local fit from its points; default: from the voxel size\n"
                  "and the measured noise")
            ->group(group);
        app.add_option("--alpha", mOptions.alpha,
                       "Radius of a fit's support, in diagonals of its cell; larger is smoother;\n"
                       "default: 0.75, with --interpolate 1.25")
            ->type_name("RATIO")
            ->group(group);
        app.add_option("--min-points", mOptions.minPoints,
                       "Points that a local fit needs; default: 15")
            ->type_name("N")
            ->group(group);
        app.add_flag_callback(
               "--no-sharp", [this] { mOptions.sharp = false; },
               "Fit no edges and corners: smooth everywhere")
            ->group(group);
        app.add_flag(
               "--interpolate", mOptions.interpolate,
               "Pass through every point: for points that are exact. No edges and corners;\n"
               "--tolerance still rules where cells are large beside the spacing, --min-points\n"
               "the neighbors of a point that shape the surface at it; --alpha from 1.05 on")
            ->group(group);
    }

    void addPointOptions(CLI::App& app)
    {
        const char* const group = "Points";
        app.add_option(
               "--normals", mNormals,
               "auto: those of the files, what is flipped among them or all about a closed solid\n"
               "turned, estimated where there are none; keep: as they are; estimate: always")
            ->type_name("auto|keep|estimate")
            ->check(oneOf({"auto", "keep", "estimate"}))
            ->capture_default_str()
            ->group(group);
        app.add_option(
               "--viewpoint", mViewpoints,
               "Where the scanner stood: estimated normals look towards it. One for all\n"
               "inputs, or one for each in their order; range images and PTX know their own.\n"
               "Normals of the files are then taken as they are")
            ->type_name("X,Y,Z")
            ->allow_extra_args(false)
            ->group(group);
        app.add_option("--outliers", mOutliers,
                       "What is done with points that lie away from every surface")
            ->type_name("drop|keep")
            ->check(oneOf({"drop", "keep"}))
            ->capture_default_str()
            ->group(group);
        app.add_flag("--flip-normals", mFlipNormals, "Turn all normals round: they point inward")
            ->group(group);
        app.add_option("--bad-points", mBadPoints,
                       "What is done with points that are not finite or have no normal")
            ->type_name("drop|fail")
            ->check(oneOf({"drop", "fail"}))
            ->capture_default_str()
            ->group(group);
    }

    PointInput readInput(Session& session)
    {
        CleanSettings cleaning;
        cleaning.normals = mNormals == "keep"       ? NormalsFrom::Keep
                           : mNormals == "estimate" ? NormalsFrom::Estimate
                                                    : NormalsFrom::Auto;
        cleaning.dropOutliers = mOutliers == "drop";
        cleaning.flipNormals = mFlipNormals;
        mOptions.clean = cleaning;
        mOptions.coverage = wantsCoverage();
        mOptions.maxBytes = session.options().maxBytes;
        std::vector<Vec3d> viewpoints;
        for (const std::string& text : mViewpoints)
            viewpoints.push_back(parseTriple("--viewpoint", text));
        PointInput input = readPoints({mInputs.begin(), mInputs.end()},
                                      mBadPoints == "fail" ? BadPoints::Fail : BadPoints::Drop,
                                      viewpoints, mAttributes.scalars(), &session.progress());
        for (const std::string& note : input.notes) session.note(note);
        for (const std::string& warning : input.warnings) session.warn(warning);
        mAttributes.choose(!input.cloud.colors.empty());
        mOptions.attributes = mAttributes.names;
        return input;
    }

    /// Say what was done to the points.
    void describeCleaning(Session& session, const ReconstructReport& made) const
    {
        const CleanReport& report = made.cleaned;
        if (report.estimateNeighbors)
            session.note(fmt::format("normals     estimated from {} neighbors each{}",
                                     *report.estimateNeighbors,
                                     report.hadNormals ? "" : " (the points have none)"));
        if (report.flipped > 0)
            session.note(fmt::format("normals     {} looked the wrong way and were turned; "
                                     "--normals keep leaves them",
                                     report.flipped));
        if (report.turned > 0)
            session.note(fmt::format("normals     {} looked inward and were turned; --normals keep "
                                     "leaves them",
                                     report.turned));
        constexpr double kDoubtful = 0.25; // of all normals
        if (double(report.flipped) > kDoubtful * double(made.points))
            session.warn(
                fmt::format("{} of {} normals looked the wrong way; of so many some are "
                            "not found, and leave warts: --normals estimate makes new ones",
                            report.flipped, made.points));
        if (report.guessesNormals())
            session.warn(fmt::format("{:.0f} % of the points have neighbors on one line only, "
                                     "which tell no plane: their normals are guessed. Give "
                                     "normals, or lines that lie closer",
                                     100 * report.onLines));
        if (report.inward)
            session.warn(fmt::format("the normals point inward, so that inside and outside are "
                                     "exchanged; {}",
                                     mFlipNormals ? "do without --flip-normals"
                                                  : "turn them with --flip-normals"));
    }

    void foresee(Session& session, const PreparedPoints& points, std::uint64_t bareBytes) const
    {
        const bool withMesh = !mMesh.path.empty();
        const ReconstructionEstimate run = estimate(points, withMesh, &session.progress());
        const std::uint64_t peakBytes = bareBytes + run.peakBytes;
        const ResolvedSettings& s = run.settings;
        describeSettings(session, points.report);
        Json& report = session.report()["estimate"];
        report = {{"area", run.area},
                  {"leaves", run.fit.leaves},
                  {"active_voxels", run.activeVoxels},
                  {"field_bytes", run.fit.bytes},
                  {"grid_bytes", run.gridBytes},
                  {"file_bytes", run.fileBytes},
                  {"peak_bytes", peakBytes}};
        if (withMesh) report["triangles"] = run.triangles;
        summarizeSettings(session, points.report);
        const double h = s.grid.lattice.voxelSize;
        const Vec3d size = (s.boxSize / h).array() + 2 * s.grid.halfWidth;
        session.note(fmt::format("grid        voxel size {:.4g}, half-width {}, about {:.0f} x "
                                 "{:.0f} x {:.0f}, {:.3g} active voxels",
                                 h, s.grid.halfWidth, size.x(), size.y(), size.z(),
                                 double(run.activeVoxels)));
        session.note(fmt::format("would take  about {} of memory (limit {}), {} on disk",
                                 sizeText(peakBytes), sizeText(*mOptions.maxBytes),
                                 sizeText(run.fileBytes)));
        session.progress().endStage();
    }

    void describeSettings(Session& session, const ReconstructReport& made) const
    {
        const ResolvedSettings& s = made.settings;
        Json& report = session.report();
        report["settings"] = {{"voxel_size", s.grid.lattice.voxelSize},
                              {"half_width", s.grid.halfWidth},
                              {"tolerance", s.fit.tolerance},
                              {"noise", s.fit.noise},
                              {"normal_noise", s.fit.normalNoise * 180 / M_PI},
                              {"alpha", s.fit.alpha},
                              {"min_points", s.fit.minPoints},
                              {"sharp", s.fit.sharp},
                              {"interpolate", s.fit.interpolate},
                              {"normals", mNormals},
                              {"flip_normals", mFlipNormals},
                              {"bad_points", mBadPoints},
                              {"preset", mPreset},
                              {"outliers", mOutliers},
                              {"holes", mHoles.text()},
                              {"attributes", mAttributes.names},
                              {"coverage", wantsCoverage()},
                              {"max_memory", *mOptions.maxBytes}};
        if (s.grid.region)
            report["settings"]["region"] = {toJson(Vec3d(s.grid.region->min())),
                                            toJson(Vec3d(s.grid.region->max()))};
        report["input"] = {{"points", made.points},
                           {"dropped", made.dropped},
                           {"normals_turned", made.cleaned.flipped + made.cleaned.turned},
                           {"spacing", s.points.spacing},
                           {"noise", s.points.noise},
                           {"normal_noise", s.points.normalNoise * 180 / M_PI},
                           {"box", toJson(s.boxSize)},
                           {"diagonal", s.diagonal}};
    }

    void describe(Session& session, const ReconstructResult& made) const
    {
        describeSettings(session, made.report);
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

    static std::string regionText(const Box3d& box)
    {
        const Vec3d &a = box.min(), &b = box.max();
        return fmt::format("{} {} {} {} {} {}", a.x(), a.y(), a.z(), b.x(), b.y(), b.z());
    }

    std::map<std::string, std::string> metadata(const ReconstructResult& made) const
    {
        const ResolvedSettings& s = made.report.settings;
        const auto text = [](const auto& value) { return fmt::format("{}", value); };
        std::map<std::string, std::string> result = {
            {"mpuvdb:version", MPUVDB_VERSION},
            {"mpuvdb:points", text(made.report.points)},
            {"mpuvdb:spacing", text(s.points.spacing)},
            {"mpuvdb:noise", text(s.points.noise)},
            {"mpuvdb:voxel_size", text(s.grid.lattice.voxelSize)},
            {"mpuvdb:half_width", text(s.grid.halfWidth)},
            {"mpuvdb:tolerance", text(s.fit.tolerance)},
            {"mpuvdb:max_error", text(made.report.fit.maxError)},
            {"mpuvdb:alpha", text(s.fit.alpha)},
            {"mpuvdb:min_points", text(s.fit.minPoints)},
            {"mpuvdb:sharp", text(s.fit.sharp)}};
        if (s.fit.interpolate) result["mpuvdb:interpolate"] = text(true);
        if (s.grid.region) result["mpuvdb:region"] = regionText(*s.grid.region);
        return result;
    }

    void summarizeSettings(Session& session, const ReconstructReport& made) const
    {
        const ResolvedSettings& s = made.settings;
        const double h = s.grid.lattice.voxelSize;
        const std::string dropped = droppedText(made.dropped);
        session.note(fmt::format("points      {}, spacing {:.4g}, noise {:.2g}{}", made.points,
                                 s.points.spacing, s.points.noise,
                                 dropped.empty() ? "" : "; dropped: " + dropped));
        session.note(
            fmt::format("fit         tolerance {:.4g} ({:.2g}vx), alpha {}, min-points {}, {}",
                        s.fit.tolerance, s.fit.tolerance / h, s.fit.alpha, s.fit.minPoints,
                        s.fit.interpolate ? "interpolate"
                        : s.fit.sharp     ? "sharp"
                                          : "no-sharp"));
    }

    void summarize(Session& session, const ReconstructResult& made) const
    {
        const ResolvedSettings& s = made.report.settings;
        summarizeSettings(session, made.report);
        const auto size = made.grid->evalActiveVoxelDim();
        session.note(fmt::format("grid        voxel size {:.4g}, half-width {}, {} x {} x {}, {} "
                                 "active voxels: {}",
                                 s.grid.lattice.voxelSize, s.grid.halfWidth, size.x(), size.y(),
                                 size.z(), made.grid->activeVoxelCount(), mOutput));
        session.note("time        " + session.timesText());
    }

    std::vector<std::string> mInputs;
    std::string mOutput, mUsd;
    MeshOutput mMesh;
    std::string mPreset, mPresetOptions; ///< its name; what it set
    std::string mNormals = "auto", mBadPoints = "drop", mOutliers = "drop";
    std::vector<std::string> mViewpoints;
    bool mFlipNormals = false, mCoverage = false, mDryRun = false;
    Holes mHoles;
    Attributes mAttributes;
    ReconstructOptions mOptions;
};

} // namespace

std::unique_ptr<Verb> makeReconstruct()
{
    return std::make_unique<Reconstruct>();
}

} // namespace mpuvdb::command
