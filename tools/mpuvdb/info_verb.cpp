// mpuvdb info: what is in a file.
#include "describe.h"
#include "memory_limit.h"
#include "output_check.h"
#include "standard_output.h"
#include "verb.h"

#include <mpuvdb/io.h>

#include <fmt/format.h>

namespace mpuvdb::command
{
namespace
{

Json toJson(const openvdb::Coord& c)
{
    return {c.x(), c.y(), c.z()};
}
Json toJson(const openvdb::Vec3d& v)
{
    return {v.x(), v.y(), v.z()};
}

Json describeGrid(const openvdb::GridBase& grid)
{
    const openvdb::CoordBBox box = grid.evalActiveVoxelBoundingBox();
    Json json{{"name", grid.getName()},
              {"type", grid.type()},
              {"class", openvdb::GridBase::gridClassToString(grid.getGridClass())},
              {"voxel_size", toJson(grid.voxelSize())},
              {"active_voxels", grid.activeVoxelCount()},
              {"bytes", grid.memUsage()}};
    if (const auto* const floats = dynamic_cast<const openvdb::FloatGrid*>(&grid)) {
        json["background"] = floats->background();
        if (grid.getGridClass() == openvdb::GRID_LEVEL_SET)
            json["half_width"] = double(floats->background()) / grid.voxelSize().x();
    }
    if (!box.empty()) {
        json["voxels"] = {{"min", toJson(box.min())}, {"max", toJson(box.max())}};
        json["world"] = {{"min", toJson(grid.indexToWorld(box.min()))},
                         {"max", toJson(grid.indexToWorld(box.max()))}};
    }
    Json metadata = Json::object();
    for (auto item = grid.beginMeta(); item != grid.endMeta(); ++item)
        metadata[item->first] = item->second->str();
    json["metadata"] = metadata;
    return json;
}

Json describePoints(const std::string& file, Progress& progress)
{
    const PointInput input = readPoints({file}, BadPoints::Drop, progress);
    const PointCloud& cloud = input.cloud;
    const Box3d box = cloud.localBounds();
    Json json{{"points", cloud.size()},
              {"dropped", input.dropped},
              {"normals", cloud.hasNormals()},
              {"confidence", !cloud.confidence.empty()},
              {"colors", !cloud.colors.empty()},
              {"world",
               {{"min", command::toJson(Vec3d(cloud.frame + box.min()))},
                {"max", command::toJson(Vec3d(cloud.frame + box.max()))}}},
              {"diagonal", box.diagonal().norm()}};
    const PointStatistics statistics = measure(cloud, progress);
    json["spacing"] = statistics.spacing;
    json["noise"] = statistics.noise;
    if (cloud.hasNormals()) json["normal_noise"] = statistics.normalNoise * 180 / M_PI;
    json["notes"] = input.notes;
    return json;
}

/// The same things in lines: "    key: value", deeper by two blanks per level.
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
        return {"info", "What is in point, mesh and .vdb files",
                "  mpuvdb info scan.ply\n"
                "  mpuvdb info scan.vdb --json\n"};
    }

    void addOptions(CLI::App& app) override
    {
        app.add_option("input", mInputs, "Files of points, meshes or grids; - is standard input")
            ->required();
        app.add_flag("--json", mJson, "Print JSON");
    }

    ExitCode run(Session& session) override
    {
        session.checkFiles({}, mInputs);
        Json files = Json::array();
        for (const std::string& file : mInputs) files.push_back(describe(file, session.progress()));
        session.report()["files"] = files;
        const Json all{{"files", files}};
        if (mJson) {
            printText(all.dump(2) + "\n");
        } else {
            for (const Json& file : files) printText(plainText(file, 0));
        }
        return ExitCode::Ok;
    }

private:
    static Json describe(const std::string& file, Progress& progress)
    {
        Json json{{"file", file}};
        progress.beginStage("read");
        if (extensionOf(file) != ".vdb") {
            json.update(describePoints(file, progress));
            return json;
        }
        json["grids"] = Json::array();
        for (const openvdb::GridBase::Ptr& grid : readGrids(file))
            json["grids"].push_back(describeGrid(*grid));
        return json;
    }

    std::vector<std::string> mInputs;
    bool mJson = false;
};

} // namespace

std::unique_ptr<Verb> makeInfo()
{
    return std::make_unique<Info>();
}

} // namespace mpuvdb::command
