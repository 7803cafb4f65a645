// mpuvdb measure, analyze: a level set asked at points, and what its surface is like.
#include "level_set_verb.h"

#include <mpuvdb/analysis.h>
#include <mpuvdb/error.h>
#include <mpuvdb/queries.h>

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace mpuvdb::command
{
namespace
{

class MeasureVerb final : public Verb
{
public:
    VerbText text() const override
    {
        return {"measure", "The distances of points to a level set's surface",
                "  mpuvdb measure part.vdb --points scan.ply -o deviation.ply\n"
                "      scan.ply with a property 'distance': above 0 outside, below 0 inside.\n"
                "  mpuvdb measure part.vdb --points scan.ply -o near.ply --normals\n"
                "      Its normals point away from the nearest place of the surface.\n"};
    }

    void addOptions(CLI::App& app) override
    {
        app.add_option("input", mInput, "A .vdb file with a level set; - is standard input")
            ->required();
        app.add_option(
               "--points", mPoints,
               "The points: any file that reconstruct takes. Those that are not finite, or a\n"
               "hundred times as far away as the others, are left out, and equal ones become\n"
               "one")
            ->required()
            ->type_name("FILE");
        app.add_option("-o,--output", mOutput,
                       "The points with the property 'distance', world units, negative inside.\n"
                       "Colors stay")
            ->required()
            ->type_name("OUT.ply");
        addGridName(app, mGrid);
        app.add_flag("--normals", mNormals,
                     "Replace the points' normals by the distance's gradient: away from the\n"
                     "nearest place of the surface outside, towards it inside");
    }

    ExitCode run(Session& session) override
    {
        session.checkFiles({{"-o", mOutput, {".ply"}}}, {gridPlace(mInput, mGrid).file, mPoints});
        const GridInput input = readGridInput(mInput, mGrid, session);
        if (input.levelSet.grid().empty())
            throw InputError(fmt::format("{}: the level set is empty, and nothing has a distance "
                                         "from it. Name one that holds a surface",
                                         mInput));
        Interrupter& progress = session.progress();
        progress.beginStage("read points");
        PointInput points = readPoints({mPoints}, BadPoints::Drop, {}, {}, &progress);
        PointCloud& cloud = points.cloud;
        progress.beginStage("measure");
        std::vector<Vec3d> places(cloud.size()), gradients(mNormals ? cloud.size() : 0);
        for (std::size_t i = 0; i < places.size(); ++i) places[i] = cloud.world(i);
        std::vector<double> distances(places.size());
        const Queries queries(input.levelSet);
        if (mNormals)
            queries.distances(places, distances.data(), gradients.data(), &progress);
        else
            queries.distances(places, distances.data(), &progress);
        cloud.scalars.push_back({"distance", {distances.begin(), distances.end()}});
        if (mNormals) {
            cloud.normals.clear();
            for (const Vec3d& g : gradients) cloud.normals.push_back(g.cast<float>());
        }
        writePoints(mOutput, cloud, &progress);
        session.report()["input"] = {{"dropped", points.dropped}};
        if (const std::string dropped = droppedText(points.dropped); !dropped.empty())
            session.warn(fmt::format("{}: points without a distance: {}", mPoints, dropped));
        say(distances, input.levelSet.voxelSize(), session);
        progress.endStage();
        session.note("time        " + session.timesText());
        return ExitCode::Ok;
    }

private:
    void say(std::vector<double> distances, double voxelSize, Session& session) const
    {
        double sum = 0, squared = 0;
        std::size_t inside = 0;
        for (double& d : distances) {
            sum += d;
            squared += d * d;
            inside += d < 0;
            d = std::abs(d);
        }
        const auto count = double(distances.size());
        const double rms = std::sqrt(squared / count);
        const auto middle = distances.begin() + std::ptrdiff_t(distances.size() / 2);
        std::nth_element(distances.begin(), middle, distances.end());
        const double median = *middle;
        const double largest = *std::max_element(distances.begin(), distances.end());
        session.report()["distances"] = {{"points", distances.size()}, {"inside", inside},
                                         {"mean", sum / count},        {"rms", rms},
                                         {"median_magnitude", median}, {"largest", largest}};
        session.note(fmt::format("distances   {} points: mean {}, rms {}, median of magnitudes {}, "
                                 "largest {}; {:.1f} % inside",
                                 distances.size(), lengthText(sum / count, voxelSize),
                                 lengthText(rms, voxelSize), lengthText(median, voxelSize),
                                 lengthText(largest, voxelSize), 100 * double(inside) / count));
    }

    std::string mInput, mPoints, mOutput, mGrid;
    bool mNormals = false;
};

class AnalyzeVerb final : public Verb
{
public:
    VerbText text() const override
    {
        return {"analyze", "Normals, curvature and wall thickness of a surface as grids",
                "  mpuvdb analyze part.vdb -o part_analyzed.vdb\n"
                "      The level set with the grids 'normals', 'curvature' and 'thickness'.\n"
                "  mpuvdb analyze part.vdb -o thin.vdb --quantities thickness\n"
                "  mpuvdb mesh thin.vdb -o thin.ply --attributes thickness\n"
                "      A mesh with the thickness of the wall at each vertex.\n"};
    }

    void addOptions(CLI::App& app) override
    {
        app.add_option("input", mInput, "A .vdb file with a level set; - is standard input")
            ->required();
        app.add_option("-o,--output", mOutput, "The level set and its grids; - is standard output")
            ->required()
            ->type_name("OUT.vdb");
        addGridName(app, mGrid);
        app.add_option(
               "--quantities", mQuantities,
               "Any of normals (unit, outward), curvature (mean of the two principal ones,\n"
               "1 / world units, above 0 where convex) and thickness (diameter of the\n"
               "largest ball inside that touches the surface there, world units)")
            ->delimiter(',')
            ->type_name("NAME,...")
            ->check(oneOf({"normals", "curvature", "thickness"}));
    }

    ExitCode run(Session& session) override
    {
        session.checkFiles({{"-o", mOutput, {".vdb"}, true}}, {gridPlace(mInput, mGrid).file});
        const GridInput input = readGridInput(mInput, mGrid, session);
        const auto wants = [&](const char* name) {
            return mQuantities.empty() ||
                   std::find(mQuantities.begin(), mQuantities.end(), name) != mQuantities.end();
        };
        const AnalyzeSettings settings{wants("normals"), wants("curvature"), wants("thickness")};
        openvdb::GridCPtrVec grids = analyze(input.levelSet, settings, &session.progress());
        openvdb::GridCPtrVec others = input.others;
        for (const auto& grid : grids) others = besides(others, grid->getName(), session);
        for (const auto& grid : grids) {
            session.note(fmt::format("grid        {}: {} active voxels", grid->getName(),
                                     grid->activeVoxelCount()));
            session.report()["grids"].push_back(grid->getName());
        }
        grids.insert(grids.end(), others.begin(), others.end());
        const ExitCode code =
            writeGridOutput(input.levelSet, mOutput,
                            {{"mpuvdb:version", MPUVDB_VERSION}, {"mpuvdb:operation", "analyze"}},
                            grids, session, input.metadata);
        session.progress().endStage();
        session.note("time        " + session.timesText());
        return code;
    }

private:
    std::string mInput, mOutput, mGrid;
    std::vector<std::string> mQuantities;
};

} // namespace

std::unique_ptr<Verb> makeMeasure()
{
    return std::make_unique<MeasureVerb>();
}

std::unique_ptr<Verb> makeAnalyze()
{
    return std::make_unique<AnalyzeVerb>();
}

} // namespace mpuvdb::command
