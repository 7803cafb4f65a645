// mpuvdb sample: the virtual scanner.
#include "describe.h"
#include "standard_output.h"
#include "verb.h"

#include <mpuvdb/io.h>
#include <mpuvdb/scan_sampler.h>

#include <fmt/format.h>

namespace mpuvdb::command
{
namespace
{

const std::map<std::string, ScanSettings::Pattern> kPatterns{
    {"even", ScanSettings::Pattern::Even},
    {"random", ScanSettings::Pattern::Random},
    {"scan", ScanSettings::Pattern::Scan}};

class Sample final : public Verb
{
public:
    VerbText text() const override
    {
        return {"sample", "Points on an exact solid, as a scanner would measure them",
                "  mpuvdb sample \"sphere(1)\" -o sphere.ply --points 20000\n"
                "  mpuvdb sample \"difference(box(2,2,1), cylinder(0.4,3))\" -o part.ply \\\n"
                "      --pattern scan --views 12 --noise 0.1% --confidence\n"
                "  mpuvdb sample --list\n"
                "      All solids and Boolean combinations.\n"};
    }

    void addOptions(CLI::App& app) override
    {
        app.add_option("solid", mSolid, "The solid, such as \"torus(1,0.3)\"; see --list");
        app.add_option("-o,--output", mOutput, "The points: .ply .xyz; - is PLY on standard output")
            ->type_name("OUT.ply");
        app.add_flag("--list", mList, "List the solids and exit");
        app.add_option("--points", mScan.points, "Number of points; approximate for scans")
            ->type_name("N")
            ->capture_default_str();
        app.add_option("--pattern", mPattern,
                       "even: neighbors keep their distance; random: independent; scan: range\n"
                       "images with occlusion")
            ->type_name("even|random|scan")
            ->check(oneOf({"even", "random", "scan"}))
            ->capture_default_str();
        app.add_option("--views", mScan.views, "Number of viewpoints of a scan, spread around")
            ->type_name("N")
            ->capture_default_str();
        app.add_option("--viewpoint", mViewpoints, "Instead: one viewpoint; may be repeated")
            ->type_name("X Y Z")
            ->type_size(3)
            ->expected(1, 1000);
        app.add_flag_callback(
            "--no-normals", [this] { mScan.normals = false; }, "Positions only");
        app.add_option("--seed", mScan.seed, "The same seed gives the same bytes")
            ->type_name("N")
            ->capture_default_str();
        addFlaws(app);
    }

    ExitCode run(Session& session) override
    {
        if (mList) {
            printText(solidHelp());
            return ExitCode::Ok;
        }
        if (mSolid.empty() || mOutput.empty()) {
            throw UsageError("name a solid and an output, such as: mpuvdb sample \"sphere(1)\" -o "
                             "sphere.ply (mpuvdb sample --list shows the solids)");
        }
        session.checkFiles({{"-o", mOutput, {".ply", ".xyz"}, true}}, {});
        const std::shared_ptr<const Solid> solid = parseSolid(mSolid);
        resolve(*solid);
        const PointCloud cloud = scan(*solid, mScan, &session.progress());
        const auto write = [&](const std::filesystem::path& file) {
            writePoints(file, cloud, &session.progress());
        };
        if (mOutput == "-")
            printFile(".ply", write);
        else
            write(mOutput);
        report(session, cloud);
        return ExitCode::Ok;
    }

private:
    void addFlaws(CLI::App& app)
    {
        const char* const group = "Errors of measurement";
        addLength(app, "--noise", mNoise, "Standard deviation of the positions; 0.1% for example")
            ->group(group);
        app.add_option("--normal-noise", mScan.normalNoise,
                       "Standard deviation of the normals about each\n"
                       "of two axes: rms angles are 1.41 times that")
            ->type_name("DEGREES")
            ->group(group);
        app.add_flag("--confidence", mScan.confidence, "Write a confidence for each point")
            ->group(group);
        app.add_option("--outliers", mScan.outliers, "Share of outliers, up to 0.5")
            ->type_name("SHARE")
            ->group(group);
        app.add_option("--outlier-distance", mScan.outlierDistance,
                       "Their standard deviation per axis, in parts of the diagonal")
            ->type_name("RATIO")
            ->capture_default_str()
            ->group(group);
        app.add_option("--holes", mScan.holes, "Number of round holes in the data")
            ->type_name("N")
            ->group(group);
        app.add_option("--hole-radius", mScan.holeRadius, "Their radius, in parts of the diagonal")
            ->type_name("RATIO")
            ->capture_default_str()
            ->group(group);
    }

    void resolve(const Solid& solid)
    {
        mScan.pattern = kPatterns.at(mPattern);
        for (const auto& [x, y, z] : mViewpoints) mScan.viewpoints.emplace_back(x, y, z);
        if (!mNoise) return;
        if (mNoise->unit == Length::Unit::Voxels)
            throw UsageError(
                "--noise: a scan has no voxels; give world units or % of the diagonal");
        mScan.noise = mNoise->resolve(0, solid.bounds().diagonal().norm());
    }

    void report(Session& session, const PointCloud& cloud) const
    {
        session.report()["settings"] = {{"solid", mSolid},
                                        {"points", mScan.points},
                                        {"pattern", mPattern},
                                        {"views", mScan.views},
                                        {"noise", mScan.noise},
                                        {"normal_noise", mScan.normalNoise},
                                        {"confidence", mScan.confidence},
                                        {"normals", mScan.normals},
                                        {"outliers", mScan.outliers},
                                        {"outlier_distance", mScan.outlierDistance},
                                        {"holes", mScan.holes},
                                        {"hole_radius", mScan.holeRadius},
                                        {"seed", mScan.seed}};
        session.report()["output"] = {{"points", cloud.size()}};
        session.progress().endStage();
        session.note(fmt::format("points      {}: {}", cloud.size(), mOutput));
        session.note("time        " + session.timesText());
    }

    std::string mSolid, mOutput, mPattern = "even";
    bool mList = false;
    std::optional<Length> mNoise;
    std::vector<std::tuple<double, double, double>> mViewpoints;
    ScanSettings mScan;
};

} // namespace

std::unique_ptr<Verb> makeSample()
{
    return std::make_unique<Sample>();
}

} // namespace mpuvdb::command
