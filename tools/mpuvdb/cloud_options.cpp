#include "cloud_options.h"

#include "describe.h"
#include "level_set_verb.h"
#include "memory_limit.h"
#include "presets.h"

#include <mpuvdb/clean.h>
#include <mpuvdb/error.h>

#include <algorithm>
#include <fmt/format.h>

namespace mpuvdb::command
{
void CloudOptions::addInputs(CLI::App& app)
{
    app.add_option("input", inputs,
                   "Points: .ply .conf .xyz .pts .pwn .txt .ptx .obj .off .stl .pcd .las; - is\n"
                   "standard input. Several are joined.")
        ->required();
}

void CloudOptions::addTo(CLI::App& app)
{
    addGridOptions(app);
    addFitOptions(app);
    addPointOptions(app);
}

void CloudOptions::addGridOptions(CLI::App& app)
{
    const char* const group = "Grid";
    CLI::Option* const size =
        addLength(app, "--voxel-size", options.voxelSize,
                  "Edge of a voxel; default: the measured spacing of the points")
            ->group(group);
    app.add_option("--voxels", options.voxels,
                   "Instead: voxels along the longest side of the points' box")
        ->type_name("N")
        ->excludes(size)
        ->group(group);
    app.add_option("--half-width", options.halfWidth,
                   "Voxels of the narrow band on either side of the surface")
        ->type_name("VOXELS")
        ->capture_default_str()
        ->group(group);
}

void CloudOptions::addFitOptions(CLI::App& app)
{
    const char* const group = "Fit";
    addLength(app, "--tolerance", options.tolerance,
              "Largest distance of a local fit from its points; default: from the voxel size\n"
              "and the measured noise")
        ->group(group);
    app.add_option("--alpha", options.alpha,
                   "Radius of a fit's support, in diagonals of its cell; larger is smoother;\n"
                   "default: 0.75, with --interpolate 1.25")
        ->type_name("RATIO")
        ->group(group);
    app.add_option("--min-points", options.minPoints, "Points that a local fit needs; default: 15")
        ->type_name("N")
        ->group(group);
    app.add_flag_callback(
           "--no-sharp", [this] { options.sharp = false; },
           "Fit no edges and corners: smooth everywhere")
        ->group(group);
    app.add_flag("--interpolate", options.interpolate,
                 "Pass through every point: for points that are exact. No edges and corners;\n"
                 "--tolerance still rules where cells are large beside the spacing, --min-points\n"
                 "the neighbors of a point that shape the surface at it; --alpha from 1.05 on")
        ->group(group);
}

void CloudOptions::addPointOptions(CLI::App& app)
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
    app.add_option("--viewpoint", mViewpoints,
                   "Where the scanner stood: estimated normals look towards it. One for all\n"
                   "inputs, or one for each in their order; range images and PTX know their own.\n"
                   "Normals of the files are then taken as they are")
        ->type_name("X,Y,Z")
        ->allow_extra_args(false)
        ->group(group);
    app.add_option("--outliers", mOutliers,
                   "What is done with points that lie away from every surface; not with those\n"
                   "that are too far away, see --bad-points")
        ->type_name("drop|keep")
        ->check(oneOf({"drop", "keep"}))
        ->capture_default_str()
        ->group(group);
    app.add_flag("--flip-normals", mFlipNormals, "Turn all normals round: they point inward")
        ->group(group);
    app.add_option("--bad-points", mBadPoints,
                   "What is done with points that are not finite, have a normal of zero or a\n"
                   "coordinate that stands for no data (-9999, -32768, far below all others), or\n"
                   "are too far: a hundred times as far away as 95 % of all are from each other")
        ->type_name("drop|fail")
        ->check(oneOf({"drop", "fail"}))
        ->capture_default_str()
        ->group(group);
}

PointInput CloudOptions::read(Session& session)
{
    CleanSettings cleaning;
    cleaning.normals = mNormals == "keep"       ? NormalsFrom::Keep
                       : mNormals == "estimate" ? NormalsFrom::Estimate
                                                : NormalsFrom::Auto;
    cleaning.dropOutliers = mOutliers == "drop";
    cleaning.flipNormals = mFlipNormals;
    options.clean = cleaning;
    options.coverage = coverage || !holes.close;
    options.maxBytes = session.options().maxBytes;
    std::vector<Vec3d> viewpoints;
    for (const std::string& text : mViewpoints)
        viewpoints.push_back(parseTriple("--viewpoint", text));
    PointInput input = readPoints({inputs.begin(), inputs.end()},
                                  mBadPoints == "fail" ? BadPoints::Fail : BadPoints::Drop,
                                  viewpoints, attributes.scalars(), &session.progress());
    for (const std::string& note : input.notes) session.note(note);
    for (const std::string& warning : input.warnings) session.warn(warning);
    attributes.choose(!input.cloud.colors.empty());
    options.attributes = attributes.names;
    return input;
}

void CloudOptions::describeCleaning(Session& session, const ReconstructReport& made) const
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
        session.warn(fmt::format("{} of {} normals looked the wrong way; of so many some are "
                                 "not found, and leave warts: --normals estimate makes new ones",
                                 report.flipped, made.points));
    if (report.guessesNormals())
        session.warn(fmt::format("{:.0f} % of the points have neighbors on one line only, "
                                 "which tell no plane: their normals are guessed. Give "
                                 "normals, or lines that lie closer",
                                 100 * report.onLines));
    if (const std::string thin = report.tooThin(); !thin.empty()) session.warn(thin);
    if (report.guessesOutside())
        session.warn(fmt::format("which side is outside is a guess, as {:.0f} % of the points are "
                                 "not of a closed solid: say from where they were seen with "
                                 "--viewpoint, or give points with normals",
                                 100 * report.unclosed));
    if (report.inward)
        session.warn(fmt::format("the normals point inward, so that inside and outside are "
                                 "exchanged; {}",
                                 mFlipNormals          ? "do without --flip-normals"
                                 : mViewpoints.empty() ? "turn them with --flip-normals"
                                                       : "that is right for a room with the "
                                                         "viewpoint in it, else name another"));
}

void CloudOptions::describeSettings(Session& session, const ReconstructReport& made) const
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
                          {"preset", preset},
                          {"outliers", mOutliers},
                          {"holes", holes.text()},
                          {"attributes", attributes.names},
                          {"coverage", options.coverage},
                          {"max_memory", *options.maxBytes}};
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

void CloudOptions::summarizeSettings(Session& session, const ReconstructReport& made)
{
    const ResolvedSettings& s = made.settings;
    const double h = s.grid.lattice.voxelSize;
    const std::string dropped = droppedText(made.dropped);
    session.note(fmt::format("points      {}, spacing {:.4g}, noise {:.2g}{}", made.points,
                             s.points.spacing, s.points.noise,
                             dropped.empty() ? "" : "; dropped: " + dropped));
    session.note(fmt::format("fit         tolerance {:.4g} ({:.2g}vx), alpha {}, min-points {}, {}",
                             s.fit.tolerance, s.fit.tolerance / h, s.fit.alpha, s.fit.minPoints,
                             s.fit.interpolate ? "interpolate"
                             : s.fit.sharp     ? "sharp"
                                               : "no-sharp"));
}

} // namespace mpuvdb::command
