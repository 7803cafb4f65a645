// A USD layer that shows a .vdb file as a volume.
#include "files/text_scan.h"
#include "io/meshes/mesh_formats.h"
#include "usda_text.h"

#include <limits>

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

/// The world box of the active voxels of @a grids.
Box3d worldBounds(const openvdb::GridCPtrVec& grids)
{
    Box3d box;
    for (const openvdb::GridBase::ConstPtr& grid : grids) {
        const openvdb::CoordBBox voxels = grid->evalActiveVoxelBoundingBox();
        if (voxels.empty()) continue;
        const openvdb::BBoxd world = grid->transform().indexToWorld(voxels);
        box.extend(Vec3d(world.min().x(), world.min().y(), world.min().z()));
        box.extend(Vec3d(world.max().x(), world.max().y(), world.max().z()));
    }
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

} // namespace

void writeVolumeLayer(const fs::path& file, const fs::path& vdb, const openvdb::GridCPtrVec& grids,
                      const SceneSettings& scene)
{
    requireScene(scene);
    const std::string asset = assetPath(vdb, fs::absolute(file).parent_path());
    std::string text = usdaHead("volume", scene) + "def Volume \"volume\"\n{\n";
    const Box3d box = worldBounds(grids);
    if (!box.isEmpty())
        text += fmt::format("    float3[] extent = [({}, {}, {}), ({}, {}, {})]\n", box.min()[0],
                            box.min()[1], box.min()[2], box.max()[0], box.max()[1], box.max()[2]);
    for (const openvdb::GridBase::ConstPtr& grid : grids) {
        const std::string prim = identifier(grid->getName());
        text += fmt::format("    rel field:{0} = </volume/{0}>\n", prim);
    }
    for (const openvdb::GridBase::ConstPtr& grid : grids)
        text += fmt::format("\n    def OpenVDBAsset \"{}\"\n    {{\n        asset filePath = {}\n"
                            "        token fieldName = {}\n{}    }}\n",
                            identifier(grid->getName()), asset, quoted(grid->getName()),
                            typeText(*grid));
    text += "}\n";
    writeStream(file, [&](OutputBuffer& out) { out.text(text); });
}

} // namespace mpuvdb
