// mpuvdb info: the contents of files.
#include "describe.h"
#include "memory_limit.h"
#include "output_check.h"
#include "standard_output.h"
#include "verb.h"

#include "render/histogram.h"
#include <mpuvdb/analysis.h>
#include <mpuvdb/io.h>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

namespace mpuvdb::command
{
namespace
{

Json listOf(const openvdb::Coord& c)
{
    return {c.x(), c.y(), c.z()};
}
Json listOf(const openvdb::Vec3d& v)
{
    return {v.x(), v.y(), v.z()};
}

Json describeGrid(const openvdb::GridBase& grid)
{
    const openvdb::CoordBBox box = grid.evalActiveVoxelBoundingBox();
    Json json{{"name", grid.getName()},
              {"type", grid.type()},
              {"class", openvdb::GridBase::gridClassToString(grid.getGridClass())},
              {"voxel_size", listOf(grid.voxelSize())},
              {"active_voxels", grid.activeVoxelCount()},
              {"bytes", grid.memUsage()}};
    if (const auto* const floats = dynamic_cast<const openvdb::FloatGrid*>(&grid)) {
        json["background"] = floats->background();
        if (grid.getGridClass() == openvdb::GRID_LEVEL_SET)
            json["half_width"] = double(floats->background()) / grid.voxelSize().x();
    }
    if (!box.empty()) {
        json["voxels"] = {{"min", listOf(box.min())}, {"max", listOf(box.max())}};
        json["world"] = {{"min", listOf(grid.indexToWorld(box.min()))},
                         {"max", listOf(grid.indexToWorld(box.max()))}};
    }
    Json metadata = Json::object();
    for (auto item = grid.beginMeta(); item != grid.endMeta(); ++item)
        metadata[item->first] = item->second->str();
    json["metadata"] = metadata;
    return json;
}

Json describePoints(const PointInput& input, Interrupter& progress)
{
    const PointCloud& cloud = input.cloud;
    const Box3d box = cloud.localBounds();
    Json json{{"points", cloud.size()},
              {"dropped", input.dropped},
              {"normals", cloud.hasNormals()},
              {"confidence", !cloud.confidence.empty()},
              {"colors", !cloud.colors.empty()},
              {"scalars", input.scalarNames},
              {"world",
               {{"min", toJson(Vec3d(cloud.frame + box.min()))},
                {"max", toJson(Vec3d(cloud.frame + box.max()))}}},
              {"diagonal", box.diagonal().norm()}};
    const PointStatistics statistics = measure(cloud, &progress);
    json["spacing"] = statistics.spacing;
    json["noise"] = statistics.noise;
    if (cloud.hasNormals()) json["normal_noise"] = statistics.normalNoise * 180 / M_PI;
    json["notes"] = input.notes;
    json["warnings"] = input.warnings;
    return json;
}

/// The mesh of a file's level set.
Mesh meshOf(const std::string& file, Session& session)
{
    return extractMesh(readLevelSet(file, {}, session.options().maxBytes, Validation::SignsOnly),
                       {}, &session.progress());
}

/// The file of --against: a mesh, or points where it has no triangles.
struct Other {
    std::string file;
    Mesh mesh;
    PointCloud points;

    Other(const std::string& name, Session& session) : file(name)
    {
        Interrupter& progress = session.progress();
        progress.beginStage("read");
        if (extensionOf(file) == ".vdb") {
            mesh = meshOf(file, session);
            if (mesh.triangles.empty())
                throw InputError(fmt::format("{}: the level set is empty, and there is nothing to "
                                             "compare with. Name another file for --against",
                                             file));
            return;
        }
        PointInput input = readPoints({file}, BadPoints::Drop, {}, {}, &progress);
        if (input.triangles > 0)
            mesh = readMesh(file, &progress);
        else
            points = std::move(input.cloud);
    }
    TwoWayDistances distancesFrom(const Mesh& from, Interrupter& progress) const
    {
        return mesh.triangles.empty() ? distances(from, points, &progress)
                                      : distances(from, mesh, &progress);
    }
    std::vector<float> deviationOf(const Mesh& from, Interrupter& progress) const
    {
        return mesh.triangles.empty() ? deviation(from, points, &progress)
                                      : deviation(from, mesh, &progress);
    }
};

double diagonalOf(const Mesh& mesh)
{
    Eigen::AlignedBox3f box;
    for (const Vec3f& p : mesh.positions) box.extend(p);
    return double(box.diagonal().norm());
}

/// Where the deviations of a mesh go.
struct DeviationOutput {
    std::string map, histogram;  ///< files; empty: none
    std::optional<Length> range; ///< of the colors

    bool isWanted() const { return !map.empty() || !histogram.empty(); }
};

/// Writes @a mesh colored by its distances to @a other, with these as a scalar, and their
/// histogram. @return what they are like.
Json writeDeviations(Mesh mesh, const Other& other, const DeviationOutput& output,
                     Interrupter& progress)
{
    std::vector<float> values = other.deviationOf(mesh, progress);
    std::vector<float> magnitudes(values.size());
    std::transform(values.begin(), values.end(), magnitudes.begin(),
                   [](float v) { return std::abs(v); });
    std::sort(magnitudes.begin(), magnitudes.end());
    // Few places far off shall not make all others white.
    constexpr double kShare = 0.99;
    const double diagonal = diagonalOf(mesh);
    double range = output.range
                       ? output.range->resolve(0, diagonal)
                       : double(magnitudes[std::size_t(kShare * double(magnitudes.size() - 1))]);
    if (!(range > 0)) range = diagonal > 0 ? 1e-6 * diagonal : 1; // all is the same
    if (!output.histogram.empty()) writeHistogram(output.histogram, values, range, &progress);
    if (!output.map.empty()) {
        mesh.colors.clear();
        for (const float v : values) mesh.colors.push_back(deviationColor(double(v), range));
        mesh.scalars.push_back({"deviation", values});
        writeMesh(output.map, mesh, {}, &progress);
    }
    return {{"range", range},
            {"median_magnitude", magnitudes[magnitudes.size() / 2]},
            {"largest", magnitudes.back()},
            {"signed", !other.mesh.triangles.empty()}};
}

Json describeMesh(const Mesh& mesh, const std::optional<Other>& other,
                  const DeviationOutput& deviations, Interrupter& progress)
{
    Json json = toJson(measure(mesh));
    json["self_intersections"] = findSelfIntersections(mesh, &progress).size();
    json["colors"] = !mesh.colors.empty();
    if (!other) return json;
    const TwoWayDistances both = other->distancesFrom(mesh, progress);
    json["against"] = {{"file", other->file},
                       {"distance_to_it", toJson(both.there)},
                       {"distance_from_it", toJson(both.back)}};
    if (deviations.isWanted())
        json["against"]["deviation"] = writeDeviations(mesh, *other, deviations, progress);
    return json;
}

/// The JSON as lines of "key: value", indented by two blanks per level.
std::string plainText(const Json& json, int depth)
{
    std::string text;
    for (const auto& [key, value] : json.items()) {
        const std::string start = fmt::format("{:{}}{}: ", "", 2 * depth, key);
        if (value.is_object()) {
            text += start + "\n" + plainText(value, depth + 1);
        } else if (value.is_array() && !value.empty() && value.front().is_object()) {
            for (const Json& item : value) text += start + "\n" + plainText(item, depth + 1);
        } else {
            text += start + (value.is_string() ? value.get<std::string>() : value.dump()) + "\n";
        }
    }
    return text;
}

class Info final : public Verb
{
public:
    VerbText text() const override
    {
        return {"info", "The contents of point, mesh and .vdb files",
                "  mpuvdb info scan.ply\n"
                "  mpuvdb info scan.vdb --json\n"
                "  mpuvdb info mesh.ply --against scan.xyz\n"
                "      The mesh's measures, and its distances to the points and back.\n"
                "  mpuvdb info scan.ply --against part.vdb --map deviation.ply --histogram h.png\n"
                "      Red where the scan lies outside the part, blue where it lies inside.\n"};
    }

    void addOptions(CLI::App& app) override
    {
        app.add_option("input", mInputs, "Files of points, meshes or grids; - is standard input")
            ->required();
        app.add_flag("--json", mJson, "Print JSON");
        app.add_option("--against", mAgainst,
                       "Measure distances of the meshes to this mesh, these points or this level\n"
                       "set's zero set, and back: mean, rms and largest over the area, world units")
            ->type_name("FILE");
        CLI::Option* const against = app.get_option("--against");
        app.add_option("--map", mDeviations.map,
                       "Write the mesh with the distance of each vertex to the other surface as\n"
                       "the scalar 'deviation' and as colors: red outside, blue inside, white on\n"
                       "it. To points distances have no sign")
            ->type_name("OUT.ply")
            ->needs(against);
        app.add_option("--histogram", mDeviations.histogram,
                       "Write a picture of how often which deviation is: from -range to range, a\n"
                       "tick for each tenth, numbers at the ends, halfway and at 0")
            ->type_name("OUT.png")
            ->needs(against);
        addLength(app, "--range", mDeviations.range,
                  "Deviation of the full colors, and at the histogram's ends: world units, or %\n"
                  "of the mesh's diagonal; default: 99 % of the vertices deviate less");
    }

    ExitCode run(Session& session) override
    {
        std::vector<std::string> inputs = mInputs;
        if (!mAgainst.empty()) inputs.push_back(mAgainst);
        session.checkFiles({{"--map", mDeviations.map, {".ply", ".glb", ".usda"}},
                            {"--histogram", mDeviations.histogram, {".png"}}},
                           inputs);
        if (mDeviations.isWanted() && mInputs.size() > 1)
            throw UsageError("--map and --histogram take one mesh. Name one input");
        if (mDeviations.range && !(mDeviations.range->value > 0))
            throw UsageError("--range: must be above 0");
        std::optional<Other> other;
        if (!mAgainst.empty()) other.emplace(mAgainst, session);
        Json files = Json::array();
        for (const std::string& file : mInputs) files.push_back(describe(file, other, session));
        session.report()["files"] = files;
        if (mJson) {
            session.printJson({{"files", files}});
        } else {
            for (const Json& file : files) printText(plainText(file, 0));
        }
        return ExitCode::Ok;
    }

private:
    Json describe(const std::string& file, const std::optional<Other>& other,
                  Session& session) const
    {
        Interrupter& progress = session.progress();
        Json json{{"file", file}};
        progress.beginStage("read");
        if (extensionOf(file) != ".vdb") {
            const PointInput input = readPoints({file}, BadPoints::Drop, {}, {}, &progress);
            json.update(describePoints(input, progress));
            // Standard input cannot be read again.
            const bool isMesh = input.triangles > 0 && file != "-";
            if (isMesh)
                json["mesh"] =
                    describeMesh(readMesh(file, &progress), other, mDeviations, progress);
            if (other && !isMesh)
                throw UsageError(fmt::format("{}: --against measures meshes and level sets in "
                                             "files, and this is neither. Name one (.ply, .obj, "
                                             ".off, .stl, .vdb), and this as --against",
                                             file));
            return json;
        }
        json["grids"] = Json::array();
        for (const openvdb::GridBase::Ptr& grid : readGrids(file, session.options().maxBytes))
            json["grids"].push_back(describeGrid(*grid));
        if (other) json["mesh"] = describeMesh(meshOf(file, session), other, mDeviations, progress);
        return json;
    }

    std::vector<std::string> mInputs;
    std::string mAgainst;
    DeviationOutput mDeviations;
    bool mJson = false;
};

} // namespace

std::unique_ptr<Verb> makeInfo()
{
    return std::make_unique<Info>();
}

} // namespace mpuvdb::command
