// mpuvdb reconstruct: points in, level set (and mesh) out.
#include "describe.h"
#include "level_set_verb.h"
#include "memory_limit.h"
#include "presets.h"
#include "run_estimate.h"
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
                       "Write a USD layer too, whose volume refers to the level set's file")
            ->type_name("OUT.usda");
        addPreset(app, mPreset);
        app.add_flag("--dry-run", mDryRun,
                     "Read the points, say what the settings come to and what the run would take:\n"
                     "voxels, memory (to a fifth), size of the file. Writes nothing but a report");
        app.callback([this, &app] {
            if (mOutput.empty() && !mDryRun) throw CLI::RequiredError("--output");
            if (mSettings.region && (!mMesh.path.empty() || wantsCoverage()))
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
        outputs.push_back({"--usd", mUsd, {".usda"}});
        if (!mOutput.empty()) outputs.push_back({"-o", mOutput, {".vdb"}});
        session.checkFiles(outputs, mInputs);
        PointInput input = readInput(session);
        mDropped = input.dropped;
        mAttributes.choose(!input.cloud.colors.empty());
        if (!mAttributes.has(kColorName)) input.cloud.colors = {};
        clean(session, input.cloud);
        mPoints = input.cloud.size();

        mSettings.maxBytes = session.options().maxBytes;
        const RunEstimator estimator(input.cloud, mSettings, {!mMesh.path.empty(), wantsCoverage()},
                                     bareBytes);
        if (mDryRun) {
            foresee(session, estimator);
            return ExitCode::Ok;
        }
        estimator.demand(mSettings.maxBytes, session.progress());
        const Reconstruction made =
            reconstruct(std::move(input.cloud), mSettings, &session.progress());
        describeSettings(session, made.settings);
        describeFit(session, made);
        const PointsExplained& explained = std::get<PointsExplained>(made.levelSet.explained()->by);
        session.report()["explained"] = toJson(explained);
        const CheckReport checked = checkOf(made, session);
        const openvdb::FloatGrid::ConstPtr coverage = coverageOf(made, session);
        openvdb::GridCPtrVec beside = attributeGrids(made, session);
        if (coverage) beside.insert(beside.begin(), coverage);
        writeLevelSet(mOutput, made.levelSet, metadata(made), beside, &session.progress());
        session.report()["grid"] = toJson(made.levelSet);
        session.report()["check"] = toJson(checked);
        if (!mUsd.empty()) {
            beside.insert(beside.begin(), made.levelSet.gridPtr());
            writeVolumeLayer(mUsd, mOutput, beside, mMesh.scene);
        }
        ExitCode meshCode = ExitCode::Ok;
        if (!mMesh.path.empty()) {
            mMesh.trim = trimOf(made, coverage);
            mMesh.field = made.field.get();
            meshCode = writeMeshOf(made.levelSet, mMesh, session);
        }
        session.progress().endStage();
        summarize(session, made);
        session.note("explained   " + explainedText(explained));
        for (const CheckFinding& finding : checked.findings)
            session.warn(fmt::format("{}: {}", mOutput, findingText(finding)));
        for (const std::string& finding : explained.findings)
            session.warn(fmt::format("{}: {}", mOutput, finding));
        return checked.sound() && explained.findings.empty() ? meshCode : ExitCode::CheckFailed;
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

    static CheckReport checkOf(const Reconstruction& made, Session& session)
    {
        const SampleSettings& s = made.settings.grid;
        const openvdb::FloatGrid& grid = made.levelSet.grid();
        if (!s.region)
            return check(grid, kGradientTolerance, openvdb::CoordBBox::inf(), &session.progress());
        return check(grid, kGradientTolerance, voxelsIn(*s.region, s.lattice), &session.progress());
    }

    bool wantsCoverage() const { return mCoverage || !mHoles.close; }

    /// Null where nobody asked for it.
    openvdb::FloatGrid::ConstPtr coverageOf(const Reconstruction& made, Session& session) const
    {
        if (!wantsCoverage()) return nullptr;
        session.progress().beginStage("spacing");
        const auto coverage = made.field->coverage(&session.progress());
        const auto grid = sampleCoverage(made.levelSet, *coverage, &session.progress());
        session.report()["coverage"] = {{"name", grid->getName()},
                                        {"spacing", coverage->spacing()},
                                        {"active_voxels", grid->activeVoxelCount()},
                                        {"bytes", grid->memUsage()}};
        return grid;
    }

    /// What --attributes names; a mesh will get it from the field itself.
    openvdb::GridCPtrVec attributeGrids(const Reconstruction& made, Session& session)
    {
        if (mAttributes.names.empty()) return {};
        const std::shared_ptr<const SurfaceAttributes> attributes =
            made.field->attributes(mAttributes.names);
        mMesh.addAttributes = [attributes](Mesh& mesh, Interrupter& progress) {
            addAttributes(mesh, *attributes, &progress);
        };
        const auto grids = sampleAttributes(made.levelSet, *attributes, &session.progress());
        return {grids.begin(), grids.end()};
    }

    Trim trimOf(const Reconstruction& made, openvdb::FloatGrid::ConstPtr coverage) const
    {
        if (mHoles.close) return {};
        const ResolvedSettings& s = made.settings;
        return {std::move(coverage),
                mHoles.closeUpTo.resolve(s.grid.lattice.voxelSize, s.diagonal)};
    }

    void addGridOptions(CLI::App& app)
    {
        const char* const group = "Grid";
        CLI::Option* const size =
            addLength(app, "--voxel-size", mSettings.voxelSize,
                      "Edge of a voxel; default: the measured spacing of the points")
                ->group(group);
        app.add_option("--voxels", mSettings.voxels,
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
        app.add_option("--half-width", mSettings.halfWidth,
                       "Voxels of the narrow band on either side of the surface")
            ->type_name("VOXELS")
            ->capture_default_str()
            ->group(group);
    }

    void setRegion(const std::vector<std::string>& words)
    {
        mSettings.region.emplace();
        std::transform(words.begin(), words.end(), mSettings.region->begin(),
                       [](const std::string& word) { return Length::parse(word); });
    }

    void addFitOptions(CLI::App& app)
    {
        const char* const group = "Fit";
        addLength(app, "--tolerance", mSettings.tolerance,
                  "Largest distance of a local fit from its points; default: from the voxel size\n"
                  "and the measured noise")
            ->group(group);
        app.add_option("--alpha", mSettings.alpha,
                       "Radius of a fit's support, in diagonals of its cell; larger is smoother;\n"
                       "default: 0.75, with --interpolate 1.25")
            ->type_name("RATIO")
            ->group(group);
        app.add_option("--min-points", mSettings.minPoints,
                       "Points that a local fit needs; default: 15")
            ->type_name("N")
            ->group(group);
        app.add_flag_callback(
               "--no-sharp", [this] { mSettings.sharp = false; },
               "Fit no edges and corners: smooth everywhere")
            ->group(group);
        app.add_flag(
               "--interpolate", mSettings.interpolate,
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

    PointInput readInput(Session& session) const
    {
        std::vector<Vec3d> viewpoints;
        for (const std::string& text : mViewpoints)
            viewpoints.push_back(parseTriple("--viewpoint", text));
        PointInput input = readPoints({mInputs.begin(), mInputs.end()},
                                      mBadPoints == "fail" ? BadPoints::Fail : BadPoints::Drop,
                                      viewpoints, mAttributes.scalars(), &session.progress());
        for (const std::string& note : input.notes) session.note(note);
        for (const std::string& warning : input.warnings) session.warn(warning);
        return input;
    }

    /// Leave out outliers, and see to the normals.
    void clean(Session& session, PointCloud& cloud)
    {
        CleanSettings settings;
        settings.normals = mNormals == "keep"       ? NormalsFrom::Keep
                           : mNormals == "estimate" ? NormalsFrom::Estimate
                                                    : NormalsFrom::Auto;
        settings.dropOutliers = mOutliers == "drop";
        settings.flipNormals = mFlipNormals;
        const CleanReport report = mpuvdb::clean(cloud, settings, &session.progress());
        mSettings.points = report.statistics;
        if (report.outliers > 0) mDropped["outlier"] += report.outliers;
        mFlipped = report.flipped;
        if (report.estimateNeighbors)
            session.note(fmt::format("normals     estimated from {} neighbors each{}",
                                     *report.estimateNeighbors,
                                     report.hadNormals ? "" : " (the points have none)"));
        if (mFlipped > 0)
            session.note(fmt::format("normals     {} looked the wrong way and were turned; "
                                     "--normals keep leaves them",
                                     mFlipped));
        if (report.turned > 0)
            session.note(fmt::format("normals     {} looked inward and were turned; --normals keep "
                                     "leaves them",
                                     report.turned));
        mFlipped += report.turned;
        constexpr double kDoubtful = 0.25; // of all normals
        if (double(report.flipped) > kDoubtful * double(cloud.size()))
            session.warn(
                fmt::format("{} of {} normals looked the wrong way; of so many some are "
                            "not found, and leave warts: --normals estimate makes new ones",
                            report.flipped, cloud.size()));
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

    void foresee(Session& session, const RunEstimator& estimator) const
    {
        const RunEstimate run = estimator.estimate(&session.progress());
        const ResolvedSettings& s = run.work.settings;
        describeSettings(session, s);
        Json& report = session.report()["estimate"];
        report = {{"area", run.work.area},
                  {"leaves", run.work.fit.leaves},
                  {"active_voxels", run.work.activeVoxels},
                  {"field_bytes", run.work.fit.bytes},
                  {"grid_bytes", run.work.gridBytes},
                  {"file_bytes", run.fileBytes},
                  {"peak_bytes", run.peakBytes}};
        if (!mMesh.path.empty()) report["triangles"] = run.triangles;
        summarizeSettings(session, s);
        const double h = s.grid.lattice.voxelSize;
        const Vec3d size = (s.boxSize / h).array() + 2 * s.grid.halfWidth;
        session.note(fmt::format("grid        voxel size {:.4g}, half-width {}, about {:.0f} x "
                                 "{:.0f} x {:.0f}, {:.3g} active voxels",
                                 h, s.grid.halfWidth, size.x(), size.y(), size.z(),
                                 double(run.work.activeVoxels)));
        session.note(fmt::format("would take  about {} of memory (limit {}), {} on disk",
                                 sizeText(run.peakBytes), sizeText(mSettings.maxBytes),
                                 sizeText(run.fileBytes)));
        session.progress().endStage();
    }

    void describeSettings(Session& session, const ResolvedSettings& s) const
    {
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
                              {"max_memory", mSettings.maxBytes}};
        if (s.grid.region)
            report["settings"]["region"] = {toJson(Vec3d(s.grid.region->min())),
                                            toJson(Vec3d(s.grid.region->max()))};
        report["input"] = {
            {"points", mPoints},          {"dropped", mDropped},
            {"normals_turned", mFlipped}, {"spacing", s.points.spacing},
            {"noise", s.points.noise},    {"normal_noise", s.points.normalNoise * 180 / M_PI},
            {"box", toJson(s.boxSize)},   {"diagonal", s.diagonal}};
    }

    static void describeFit(Session& session, const Reconstruction& made)
    {
        const MpuStatistics& fit = made.field->statistics();
        session.report()["field"] = {{"cells", fit.cells},
                                     {"leaves", fit.leaves},
                                     {"levels", fit.levels},
                                     {"fits", fit.fits},
                                     {"sharp_fits", fit.sharpFits},
                                     {"max_error", fit.maxError},
                                     {"over_tolerance", fit.overTolerance},
                                     {"bytes", fit.bytes}};
    }

    static std::string regionText(const Box3d& box)
    {
        const Vec3d &a = box.min(), &b = box.max();
        return fmt::format("{} {} {} {} {} {}", a.x(), a.y(), a.z(), b.x(), b.y(), b.z());
    }

    std::map<std::string, std::string> metadata(const Reconstruction& made) const
    {
        const ResolvedSettings& s = made.settings;
        const auto text = [](const auto& value) { return fmt::format("{}", value); };
        std::map<std::string, std::string> result = {
            {"mpuvdb:version", MPUVDB_VERSION},
            {"mpuvdb:points", text(mPoints)},
            {"mpuvdb:spacing", text(s.points.spacing)},
            {"mpuvdb:noise", text(s.points.noise)},
            {"mpuvdb:voxel_size", text(s.grid.lattice.voxelSize)},
            {"mpuvdb:half_width", text(s.grid.halfWidth)},
            {"mpuvdb:tolerance", text(s.fit.tolerance)},
            {"mpuvdb:max_error", text(made.field->statistics().maxError)},
            {"mpuvdb:alpha", text(s.fit.alpha)},
            {"mpuvdb:min_points", text(s.fit.minPoints)},
            {"mpuvdb:sharp", text(s.fit.sharp)}};
        if (s.fit.interpolate) result["mpuvdb:interpolate"] = text(true);
        if (s.grid.region) result["mpuvdb:region"] = regionText(*s.grid.region);
        return result;
    }

    void summarizeSettings(Session& session, const ResolvedSettings& s) const
    {
        const double h = s.grid.lattice.voxelSize;
        const std::string dropped = droppedText(mDropped);
        session.note(fmt::format("points      {}, spacing {:.4g}, noise {:.2g}{}", mPoints,
                                 s.points.spacing, s.points.noise,
                                 dropped.empty() ? "" : "; dropped: " + dropped));
        session.note(
            fmt::format("fit         tolerance {:.4g} ({:.2g}vx), alpha {}, min-points {}, {}",
                        s.fit.tolerance, s.fit.tolerance / h, s.fit.alpha, s.fit.minPoints,
                        s.fit.interpolate ? "interpolate"
                        : s.fit.sharp     ? "sharp"
                                          : "no-sharp"));
    }

    void summarize(Session& session, const Reconstruction& made) const
    {
        const ResolvedSettings& s = made.settings;
        summarizeSettings(session, s);
        const auto size = made.levelSet.grid().evalActiveVoxelDim();
        session.note(fmt::format("grid        voxel size {:.4g}, half-width {}, {} x {} x {}, {} "
                                 "active voxels: {}",
                                 s.grid.lattice.voxelSize, s.grid.halfWidth, size.x(), size.y(),
                                 size.z(), made.levelSet.grid().activeVoxelCount(), mOutput));
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
    ReconstructSettings mSettings;
    std::uint64_t mPoints = 0, mFlipped = 0;
    std::map<std::string, std::uint64_t> mDropped;
};

} // namespace

std::unique_ptr<Verb> makeReconstruct()
{
    return std::make_unique<Reconstruct>();
}

} // namespace mpuvdb::command
