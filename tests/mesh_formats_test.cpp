// Mesh files as other programs see them: their own structure, and Blender and assimp where they are
// installed.
#include "io_fixture.h"
#include "program_output.h"

#include "io/meshes/mesh_formats.h"

#include <nlohmann/json.hpp>

#include <cstdlib>
#include <regex>
#include <sstream>

namespace mpuvdb::test
{
namespace
{

using Json = nlohmann::json;

/// A tetrahedron with a color and a number at each vertex.
Mesh tetrahedron(double far)
{
    Mesh mesh;
    mesh.frame = Vec3d(far, -far, far / 2);
    mesh.positions = {Vec3f(0, 0, 0), Vec3f(2, 0, 0), Vec3f(0, 1, 0), Vec3f(0, 0, 1.0625f)};
    mesh.triangles = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
    for (const Rgb& rgb : {Rgb{255, 0, 0}, Rgb{10, 200, 30}, Rgb{128, 128, 128}, Rgb{0, 64, 255}})
        mesh.colors.push_back(linearColor(rgb));
    mesh.scalars = {{"scan intensity", {0.25f, -1, 3e7f, 0.1f}}};
    return mesh;
}

std::string contentOf(const std::filesystem::path& file)
{
    std::ostringstream text;
    text << std::ifstream(file, std::ios::binary).rdbuf();
    return text.str();
}

template <class T>
T valueAt(const std::string& bytes, std::size_t at)
{
    T value{};
    EXPECT_LE(at + sizeof value, bytes.size());
    std::memcpy(&value, bytes.data() + at, sizeof value);
    return value;
}

using test::outputOf;

class MeshFormatsTest : public IoTest
{
protected:
    std::filesystem::path write(const std::string& name, const Mesh& mesh,
                                const SceneSettings& scene = {}) const
    {
        Interrupter progress;
        writeMesh(path(name), mesh, scene, &progress);
        return path(name);
    }
};

/// A GLB file taken apart.
struct Glb {
    Json json;
    std::string binary;

    explicit Glb(const std::string& bytes)
    {
        EXPECT_EQ(bytes.substr(0, 4), "glTF");
        EXPECT_EQ(valueAt<std::uint32_t>(bytes, 4), 2u);
        EXPECT_EQ(valueAt<std::uint32_t>(bytes, 8), bytes.size());
        const auto length = valueAt<std::uint32_t>(bytes, 12);
        EXPECT_EQ(bytes.substr(16, 4), "JSON");
        EXPECT_EQ(length % 4, 0u);
        json = Json::parse(bytes.substr(20, length));
        const std::size_t chunk = 20 + length;
        if (chunk == bytes.size()) return;
        EXPECT_EQ(bytes.substr(chunk + 4, 4), std::string("BIN\0", 4));
        EXPECT_EQ(valueAt<std::uint32_t>(bytes, chunk), bytes.size() - chunk - 8);
        binary = bytes.substr(chunk + 8);
        EXPECT_EQ(json["buffers"][0]["byteLength"], binary.size());
    }
    const Json& attribute(const char* name) const
    {
        return json["accessors"].at(
            json["meshes"][0]["primitives"][0]["attributes"].at(name).get<std::size_t>());
    }
    /// Component @a i of what an accessor describes.
    template <class T>
    T value(const Json& accessor, std::size_t i) const
    {
        const Json& view = json["bufferViews"].at(accessor["bufferView"].get<std::size_t>());
        EXPECT_LE((i + 1) * sizeof(T), view["byteLength"].get<std::size_t>());
        return valueAt<T>(binary, view["byteOffset"].get<std::size_t>() + i * sizeof(T));
    }
};

TEST_F(MeshFormatsTest, ColorsComeBackFromFilesThatHoldThem)
{
    for (const double far : {0.0, 3e6}) {
        const Mesh mesh = tetrahedron(far);
        for (const char* name : {"m.ply", "m.obj", "m.off"}) {
            Interrupter progress;
            const Mesh back = readMesh(write(name, mesh), &progress);
            ASSERT_EQ(back.triangles, mesh.triangles) << name;
            ASSERT_EQ(back.colors.size(), mesh.colors.size()) << name;
            for (std::size_t i = 0; i < 4; ++i) {
                EXPECT_EQ(srgbColor(back.colors[i]), srgbColor(mesh.colors[i])) << name;
                EXPECT_LT((back.world(i) - mesh.world(i)).norm(), 1e-6) << name;
            }
        }
    }
}

TEST(ColorTest, EveryByteComesBackAndLinearLightGrows)
{
    float before = -1;
    for (int i = 0; i < 256; ++i) {
        const auto byte = std::uint8_t(i);
        const Vec3f linear = linearColor({byte, 0, 255});
        EXPECT_EQ(srgbColor(linear), (Rgb{byte, 0, 255}));
        EXPECT_GT(linear[0], before);
        before = linear[0];
    }
    EXPECT_NEAR(linearColor({188, 0, 0})[0], 0.5, 0.005); // known of the curve
    EXPECT_EQ(srgbColor(Vec3f(-1, 2, NAN)), (Rgb{0, 255, 0}));
}

TEST_F(MeshFormatsTest, PlyHoldsScalarsByName)
{
    const std::string bytes = contentOf(write("m.ply", tetrahedron(0)));
    EXPECT_NE(bytes.find("property uchar blue\nproperty float scan_intensity\nelement face 4\n"),
              std::string::npos);
    const std::size_t data = bytes.find("end_header\n") + 11;
    EXPECT_EQ(bytes.size(), data + 4 * (12 + 3 + 4) + 4 * 13);
    EXPECT_EQ(valueAt<float>(bytes, data + 2 * 19 + 15), 3e7f);
}

TEST_F(MeshFormatsTest, GlbIsWholeAndKeepsPrecisionFarAway)
{
    const Mesh mesh = tetrahedron(4e6);
    const Glb glb(contentOf(write("m.glb", mesh)));
    EXPECT_EQ(glb.json["asset"]["version"], "2.0");
    const Json& node = glb.json["nodes"][0];
    EXPECT_EQ(node["translation"], Json({4e6, -4e6, 2e6}));
    EXPECT_FALSE(node.contains("rotation") || node.contains("scale"));
    const Json& positions = glb.attribute("POSITION");
    EXPECT_EQ(positions["count"], 4);
    EXPECT_EQ(positions["min"], Json({0.0, 0.0, 0.0}));
    EXPECT_EQ(positions["max"], Json({2.0, 1.0, 1.0625}));
    EXPECT_EQ(glb.value<float>(positions, 11), 1.0625f);
    const Json& colors = glb.attribute("COLOR_0");
    EXPECT_EQ(colors["type"], "VEC4");
    EXPECT_NEAR(glb.value<std::uint16_t>(colors, 5) / 65535.0, double(mesh.colors[1][1]), 1e-5);
    EXPECT_EQ(glb.value<float>(glb.attribute("_scan_intensity"), 2), 3e7f);
    const Json& primitive = glb.json["meshes"][0]["primitives"][0];
    const Json& indices = glb.json["accessors"][primitive["indices"].get<std::size_t>()];
    EXPECT_EQ(indices["count"], 12);
    EXPECT_EQ(glb.value<std::uint32_t>(indices, 1), 2u);
}

TEST_F(MeshFormatsTest, GlbStandsUprightInMeters)
{
    const Mesh mesh = tetrahedron(1000);
    const Glb glb(contentOf(write("m.glb", mesh, {UpAxis::Z, 0.001})));
    const Json& node = glb.json["nodes"][0];
    EXPECT_EQ(node["translation"], Json({1.0, 0.5, 1.0})); // x, z, -y
    EXPECT_EQ(node["scale"], Json({0.001, 0.001, 0.001}));
    const auto q = node["rotation"].get<std::vector<double>>();
    const Eigen::Quaterniond turn(q[3], q[0], q[1], q[2]);
    EXPECT_LT((turn * Vec3d::UnitZ() - Vec3d::UnitY()).norm(), 1e-12);
    EXPECT_LT((turn * Vec3d::UnitX() - Vec3d::UnitX()).norm(), 1e-12);
}

TEST_F(MeshFormatsTest, EmptyMeshesMakeValidFiles)
{
    const Glb glb(contentOf(write("m.glb", Mesh())));
    EXPECT_TRUE(glb.binary.empty());
    EXPECT_FALSE(glb.json.contains("meshes") || glb.json.contains("accessors"));
    EXPECT_NE(contentOf(write("m.usda", Mesh())).find("point3f[] points = []"), std::string::npos);
    EXPECT_EQ(contentOf(write("m.off", Mesh())), "OFF\n0 0 0\n");
}

TEST_F(MeshFormatsTest, WhatGlbCannotHoldIsALimitError)
{
    EXPECT_NO_THROW(requireGlbFits(GlbSizes(300000000, 50000000).indices, 1000, "m.glb"));
    const GlbSizes sizes(340000000, 170000000);
    try {
        requireGlbFits(sizes.indices + sizes.positions, 1000, "m.glb");
        ADD_FAILURE() << "it fits";
    } catch (const LimitError& e) {
        EXPECT_NE(std::string(e.what()).find("5.70 GiB"), std::string::npos) << e.what();
    }
}

TEST_F(MeshFormatsTest, WhatIsWrongIsRefusedBeforeAFileAppears)
{
    Mesh mesh = tetrahedron(0);
    mesh.colors.pop_back();
    EXPECT_THROW(write("m.glb", mesh), UsageError);
    mesh = tetrahedron(0);
    mesh.scalars[0].values.push_back(1);
    EXPECT_THROW(write("m.ply", mesh), UsageError);
    EXPECT_THROW(write("m.usda", tetrahedron(0), {UpAxis::Y, 0}), UsageError);
    EXPECT_THROW(write("m.fbx", tetrahedron(0)), UsageError);
    for (const float far : {std::numeric_limits<float>::infinity(), std::nanf("")}) {
        mesh = tetrahedron(0);
        mesh.positions[1][2] = far;
        for (const char* name : {"m.glb", "m.ply", "m.usda", "m.obj", "m.off", "m.stl"})
            EXPECT_THROW(write(name, mesh), InputError) << name;
    }
    EXPECT_THROW(write("m.ply", tetrahedron(1e39)), InputError);
    for (const char* name : {"m.glb", "m.ply", "m.usda", "m.fbx", "m.obj", "m.off", "m.stl"})
        EXPECT_FALSE(std::filesystem::exists(path(name))) << name;
}

/// The text after "NAME = [" up to the bracket that closes it.
std::string usdArray(const std::string& text, const std::string& name)
{
    const std::size_t at = text.find(name + " = [");
    if (at == std::string::npos) return "missing";
    const std::size_t begin = at + name.size() + 4;
    return std::regex_replace(text.substr(begin, text.find(']', begin) - begin), std::regex("\\s+"),
                              " ");
}

TEST_F(MeshFormatsTest, UsdaDescribesTheMesh)
{
    const std::string text = contentOf(write("m.usda", tetrahedron(4e6), {UpAxis::Z, 0.01}));
    EXPECT_EQ(text.rfind("#usda 1.0\n", 0), 0u);
    for (const char* line : {"defaultPrim = \"surface\"", "metersPerUnit = 0.01", "upAxis = \"Z\"",
                             "def Mesh \"surface\"", "uniform token orientation = \"rightHanded\"",
                             "uniform token subdivisionScheme = \"none\"",
                             "double3 xformOp:translate = (4000000, -4000000, 2000000)"})
        EXPECT_NE(text.find(line), std::string::npos) << line;
    EXPECT_EQ(usdArray(text, "int[] faceVertexCounts"), "3, 3, 3, 3");
    EXPECT_EQ(usdArray(text, "int[] faceVertexIndices"), "0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3");
    EXPECT_EQ(usdArray(text, "point3f[] points"),
              "(0, 0, 0), (2, 0, 0), (0, 1, 0), (0, 0, 1.0625)");
    EXPECT_EQ(usdArray(text, "float[] primvars:scan_intensity"), "0.25, -1, 30000000, 0.1");
    EXPECT_EQ(usdArray(text, "color3f[] primvars:displayColor").substr(0, 9), "(1, 0, 0)");
    EXPECT_EQ(std::count(text.begin(), text.end(), '{'), std::count(text.begin(), text.end(), '}'));
    EXPECT_EQ(std::count(text.begin(), text.end(), '('), std::count(text.begin(), text.end(), ')'));
}

TEST_F(MeshFormatsTest, AVolumeLayerRefersToItsFileByARelativePath)
{
    std::filesystem::create_directories(path("vdb"));
    std::filesystem::create_directories(path("layers"));
    auto surface = openvdb::FloatGrid::create(3);
    surface->setName("surface");
    surface->setGridClass(openvdb::GRID_LEVEL_SET);
    surface->setTransform(openvdb::math::Transform::createLinearTransform(0.5));
    surface->fill(openvdb::CoordBBox(openvdb::Coord(-2), openvdb::Coord(4)), 1);
    auto color = openvdb::Vec3SGrid::create();
    color->setName("Cd");
    writeVolumeLayer(path("layers/s.usda"), path("vdb/s.vdb"), {surface, color});
    const std::string text = contentOf(path("layers/s.usda"));
    for (const char* line : {"def Volume \"volume\"", "float3[] extent = [(-1, -1, -1), (2, 2, 2)]",
                             "rel field:surface = </volume/surface>", "rel field:Cd = </volume/Cd>",
                             "def OpenVDBAsset \"surface\"", "asset filePath = @./../vdb/s.vdb@",
                             "token fieldName = \"surface\"", "token fieldDataType = \"float\"",
                             "token fieldClass = \"levelSet\"", "token fieldDataType = \"float3\"",
                             "token vectorDataRoleHint = \"Color\""})
        EXPECT_NE(text.find(line), std::string::npos) << line << "\n" << text;
}

/// Prints one JSON object per mesh that Blender imports: its vertices, triangles, box (in Blender's
/// own coordinates, Z up) and first colors.
constexpr const char* kBlenderScript = R"(
import bpy, json, numpy, sys
if not hasattr(numpy, "bool"):  # which Blender 3.4's glTF importer asks newer versions of it for
    numpy.bool = bool
importers = {"ply": lambda f: bpy.ops.import_mesh.ply(filepath=f),
             "stl": lambda f: bpy.ops.import_mesh.stl(filepath=f, axis_forward="Y", axis_up="Z"),
             "obj": lambda f: bpy.ops.wm.obj_import(filepath=f, forward_axis="Y", up_axis="Z"),
             "glb": lambda f: bpy.ops.import_scene.gltf(filepath=f)}
for file in sys.argv[sys.argv.index("--") + 1:]:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    importers[file.rsplit(".", 1)[1]](file)
    object = [o for o in bpy.data.objects if o.type == "MESH"][0]
    places = [object.matrix_world @ v.co for v in object.data.vertices]
    layers = object.data.color_attributes
    print("MESH", json.dumps({
        "file": file, "vertices": len(places),
        "triangles": sum(len(p.vertices) == 3 for p in object.data.polygons),
        "min": [min(p[k] for p in places) for k in range(3)],
        "max": [max(p[k] for p in places) for k in range(3)],
        "colors": len(layers) and [list(d.color_srgb) for d in layers[0].data]}))
)";

TEST_F(MeshFormatsTest, BlenderReadsThem)
{
    if (outputOf("blender --version").rfind("Blender", 0) != 0)
        GTEST_SKIP() << "there is no Blender (apt-get install blender)";
    const Mesh mesh = tetrahedron(0);
    std::string files;
    for (const char* name : {"m.ply", "m.obj", "m.stl", "m.glb"})
        files += " " + write(name, mesh, {UpAxis::Z, 0.5}).string();
    std::istringstream output(outputOf("blender --background --factory-startup --python " +
                                       put("read.py", kBlenderScript).string() + " -- " + files));
    std::string line;
    int meshes = 0;
    while (std::getline(output, line)) {
        if (line.rfind("MESH ", 0) != 0) continue;
        ++meshes;
        const Json found = Json::parse(line.substr(5));
        const std::string name = std::filesystem::path(found["file"].get<std::string>()).filename();
        EXPECT_EQ(found["vertices"], 4) << name;
        EXPECT_EQ(found["triangles"], 4) << name;
        const double scale = name == "m.glb" ? 0.5 : 1; // Blender turns glTF back to Z up
        for (std::size_t k = 0; k < 3; ++k) {
            EXPECT_NEAR(found["min"][k].get<double>(), 0, 1e-6) << name;
            EXPECT_NEAR(found["max"][k].get<double>(), scale * Vec3d(2, 1, 1.0625)[int(k)], 1e-6)
                << name;
        }
        if (name == "m.stl") continue;
        bool green = false; // the second vertex, whatever the order of corners
        for (const Json& color : found["colors"])
            green |= std::abs(color[1].get<double>() - 200 / 255.0) < 0.01 &&
                     std::abs(color[0].get<double>() - 10 / 255.0) < 0.01;
        EXPECT_TRUE(green) << name << found["colors"];
    }
    EXPECT_EQ(meshes, 4);
}

TEST_F(MeshFormatsTest, StlIsRefusedWhereFloatsCollapseTriangles)
{
    Mesh mesh = tetrahedron(0);
    mesh.frame = Vec3d(5e5, 4e6, 0); // a survey's meters: a quarter apart
    EXPECT_NO_THROW(write("near.stl", mesh));
    mesh.frame *= 100;
    EXPECT_THROW(write("far.stl", mesh), InputError);
    EXPECT_FALSE(std::filesystem::exists(path("far.stl")));
    EXPECT_NO_THROW(write("far.obj", mesh));
}

TEST_F(MeshFormatsTest, AssimpReadsThem)
{
    if (outputOf("assimp version").empty())
        GTEST_SKIP() << "there is no assimp (apt-get install assimp-utils)";
    for (const char* name : {"m.ply", "m.obj", "m.off", "m.stl", "m.glb"}) {
        const std::string info = outputOf("assimp info " + write(name, tetrahedron(0)).string());
        std::smatch faces;
        ASSERT_TRUE(std::regex_search(info, faces, std::regex("Faces:\\s+(\\d+)"))) << name << info;
        EXPECT_EQ(faces[1], "4") << name;
    }
}

} // namespace
} // namespace mpuvdb::test
