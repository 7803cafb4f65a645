// A USD layer that shows a .vdb file as a volume.
#include "files/text_scan.h"
#include "io/meshes/mesh_formats.h"
#include "usda_text.h"
#include <mpuvdb/error.h>

#include <algorithm>
#include <set>

namespace mpuvdb
{
namespace
{

namespace fs = std::filesystem;

/// The asset path of @a to in a layer in @a folder: relative where possible.
std::string assetPath(const fs::path& to, const fs::path& folder)
{
    const fs::path whole = fs::absolute(to).lexically_normal();
    const fs::path way = whole.lexically_relative(fs::absolute(folder).lexically_normal());
    const std::string text = way.empty() ? whole.generic_string() : "./" + way.generic_string();
    const char* const quote = text.find('@') == std::string::npos ? "@" : "@@@";
    return quote + text + quote;
}

/// The world box of @a voxels of @a grid.
Box3d worldBounds(const openvdb::GridBase& grid, const openvdb::CoordBBox& voxels)
{
    Box3d box;
    if (voxels.empty()) return box;
    const openvdb::BBoxd world = grid.transform().indexToWorld(voxels);
    box.extend(Vec3d(world.min().x(), world.min().y(), world.min().z()));
    box.extend(Vec3d(world.max().x(), world.max().y(), world.max().z()));
    return box;
}

/// The world box of the active voxels of @a grids.
Box3d worldBounds(const openvdb::GridCPtrVec& grids)
{
    Box3d box;
    for (const openvdb::GridBase::ConstPtr& grid : grids)
        box.extend(worldBounds(*grid, grid->evalActiveVoxelBoundingBox()));
    return box;
}

/// USD's attributes for the type and the class of a grid's values.
std::string typeText(const openvdb::GridBase& grid)
{
    const std::string type = grid.valueType();
    const bool isVector = type == "vec3s";
    std::string text;
    if (type == "float" || type == "double" || type == "int32" || isVector)
        text += fmt::format("        token fieldDataType = \"{}\"\n", isVector          ? "float3"
                                                                      : type == "int32" ? "int"
                                                                                        : type);
    if (isVector && grid.getName() == "Cd")
        text += "        token vectorDataRoleHint = \"Color\"\n";
    if (grid.getGridClass() == openvdb::GRID_LEVEL_SET)
        text += "        token fieldClass = \"levelSet\"\n";
    if (grid.getGridClass() == openvdb::GRID_FOG_VOLUME)
        text += "        token fieldClass = \"fogVolume\"\n";
    return text;
}

std::string quoted(const std::string& name)
{
    std::string text = "\"";
    for (const char c : name) {
        if (c == '"' || c == '\\') text += '\\';
        text += c;
    }
    return text + '"';
}

/// USD's array of a box's two corners.
std::string extentText(const Box3d& box)
{
    return fmt::format("[({}, {}, {}), ({}, {}, {})]", box.min()[0], box.min()[1], box.min()[2],
                       box.max()[0], box.max()[1], box.max()[2]);
}

/// A grid of a volume.
struct GridText {
    std::string name, type, path; ///< path: the attribute with the path of its file
};

/// The prim of a volume. @param parent  the path of the prim above it, or nothing. @param
/// properties of the volume, beside its fields.
std::string volumeText(const std::string& parent, const std::string& name,
                       const std::string& properties, const std::vector<GridText>& grids)
{
    std::string text = fmt::format("def Volume \"{}\"\n{{\n{}", name, properties);
    for (const GridText& grid : grids)
        text +=
            fmt::format("    rel field:{0} = <{1}/{2}/{0}>\n", identifier(grid.name), parent, name);
    for (const GridText& grid : grids)
        text += fmt::format("\n    def OpenVDBAsset \"{}\"\n    {{\n        asset filePath{}\n"
                            "        token fieldName = {}\n{}    }}\n",
                            identifier(grid.name), grid.path, quoted(grid.name), grid.type);
    return text + "}\n";
}

/// The attribute with a volume's box; nothing without one.
std::string extentText(const char* indent, const Box3d& box)
{
    return box.isEmpty() ? "" : fmt::format("{}float3[] extent = {}\n", indent, extentText(box));
}

void writeLayer(const fs::path& file, const std::string& text)
{
    writeStream(file, [&](OutputBuffer& out) { out.text(text); });
}

/// The values of an attribute by time code, as USD writes them.
class TimeSamples
{
public:
    void add(int time, const std::string& value)
    {
        mText += fmt::format("            {}: {},\n", time, value);
    }
    std::string text() const { return ".timeSamples = {\n" + mText + "        }"; }

private:
    std::string mText;
};

/// The world box of the active voxels of @a grid, whose metadata say it; empty without them.
Box3d boundsByMetadata(const openvdb::GridBase& grid)
{
    const auto min =
        grid.getMetadata<openvdb::Vec3IMetadata>(openvdb::GridBase::META_FILE_BBOX_MIN);
    const auto max =
        grid.getMetadata<openvdb::Vec3IMetadata>(openvdb::GridBase::META_FILE_BBOX_MAX);
    if (!min || !max) return {};
    return worldBounds(grid, {openvdb::Coord(min->value()), openvdb::Coord(max->value())});
}

/// @throws UsageError.
void requireFrames(const std::vector<VolumeFrame>& frames)
{
    const auto falls = [](const VolumeFrame& a, const VolumeFrame& b) {
        return a.number >= b.number;
    };
    if (frames.empty() || std::adjacent_find(frames.begin(), frames.end(), falls) != frames.end())
        throw UsageError("a layer of a sequence needs frames with ascending numbers");
}

} // namespace

void writeVolumeLayer(const fs::path& file, const fs::path& vdb, const openvdb::GridCPtrVec& grids,
                      const SceneSettings& scene)
{
    requireScene(scene);
    const std::string asset = assetPath(vdb, fs::absolute(file).parent_path());
    const Box3d box = worldBounds(grids);
    std::vector<GridText> texts;
    for (const openvdb::GridBase::ConstPtr& grid : grids)
        texts.push_back({grid->getName(), typeText(*grid), " = " + asset});
    writeLayer(file, usdaHead("volume", scene) +
                         volumeText("", "volume", extentText("    ", box), texts));
}

void writeVolumeLayer(const fs::path& file, const std::vector<VolumeFrame>& frames,
                      const SceneSettings& scene)
{
    requireScene(scene);
    requireFrames(frames);
    const fs::path folder = fs::absolute(file).parent_path();
    std::vector<GridText> texts; // of all grids of all frames, by their first appearance
    std::vector<std::set<std::string>> there;
    TimeSamples extents;
    for (const VolumeFrame& frame : frames) {
        Box3d box;
        there.emplace_back();
        for (const openvdb::GridBase::ConstPtr& grid : readGridHeads(frame.vdb)) {
            box.extend(boundsByMetadata(*grid));
            const std::string name = grid->getName();
            there.back().insert(name);
            const auto isSame = [&](const GridText& text) { return text.name == name; };
            if (std::none_of(texts.begin(), texts.end(), isSame))
                texts.push_back({name, typeText(*grid), {}});
        }
        extents.add(frame.number, box.isEmpty() ? "None" : extentText(box));
    }
    for (GridText& text : texts) {
        TimeSamples paths;
        for (std::size_t n = 0; n < frames.size(); ++n)
            paths.add(frames[n].number,
                      there[n].count(text.name) ? assetPath(frames[n].vdb, folder) : "None");
        text.path = paths.text();
    }
    const std::string time = fmt::format("    startTimeCode = {}\n    endTimeCode = {}\n",
                                         frames.front().number, frames.back().number);
    writeLayer(file,
               usdaHead("volume", scene, time) +
                   volumeText("", "volume", "    float3[] extent" + extents.text() + "\n", texts));
}

void writeVolumeLayer(const fs::path& file, const std::vector<VolumePart>& parts,
                      const SceneSettings& scene)
{
    requireScene(scene);
    const fs::path folder = fs::absolute(file).parent_path();
    std::string volumes;
    for (const VolumePart& part : parts) {
        Box3d box;
        std::vector<GridText> texts;
        for (const openvdb::GridBase::ConstPtr& grid : readGridHeads(part.vdb)) {
            box.extend(boundsByMetadata(*grid));
            texts.push_back(
                {grid->getName(), typeText(*grid), " = " + assetPath(part.vdb, folder)});
        }
        const std::string purpose = part.isProxy ? "    uniform token purpose = \"proxy\"\n"
                                                 : "    uniform token purpose = \"render\"\n";
        volumes += "\n" + volumeText("/volume", identifier(part.vdb.stem().string()),
                                     purpose + extentText("    ", box), texts);
    }
    writeLayer(file, usdaHead("volume", scene) +
                         "def Xform \"volume\" (\n    kind = "
                         "\"component\"\n)\n{\n" +
                         volumes + "}\n");
}

} // namespace mpuvdb
