// Results that moves and renames must not change: hashes of small reconstructions, operations and
// meshes, held against tests/golden.txt, on one thread and on many.
// MPUVDB_RENEW_GOLDEN=1 tests/golden_test writes that file anew and says what changed by how much.
#include "closed_parts.h"
#include "field_fixture.h"

#include <mpuvdb/attribute_grids.h>
#include <mpuvdb/clean.h>
#include <mpuvdb/fields.h>
#include <mpuvdb/mesh.h>
#include <mpuvdb/operations.h>
#include <mpuvdb/reconstruct.h>
#include <mpuvdb/shape.h>

#include <gtest/gtest.h>
#include <openvdb/tree/LeafManager.h>
#include <tbb/global_control.h>

#include <cstdlib>
#include <cstring>
#include <fstream>
#include <functional>
#include <iomanip>
#include <map>
#include <thread>

namespace mpuvdb
{
namespace
{

/// A hash of a result's content, and two numbers that say how much it changed where it did: of a
/// grid its active voxels and the sum of their values, of a mesh its triangles and their area.
struct Golden {
    std::uint64_t hash = 0;
    double count = 0, sum = 0;
};

/// FNV-1a, over the bytes of numbers.
class Hash
{
public:
    template <class T>
    void add(const T& value)
    {
        unsigned char bytes[sizeof(T)];
        std::memcpy(bytes, &value, sizeof(T));
        for (const unsigned char byte : bytes) mValue = (mValue ^ byte) * 0x100000001b3u;
    }
    std::uint64_t value() const { return mValue; }

private:
    std::uint64_t mValue = 0xcbf29ce484222325u;
};

double sumOf(float value)
{
    return double(value);
}
double sumOf(const openvdb::Vec3s& value)
{
    return double(value.x()) + double(value.y()) + double(value.z());
}

template <class Grid>
Golden goldenOf(const Grid& grid)
{
    Golden golden;
    Hash hash;
    hash.add(grid.background());
    for (auto value = grid.cbeginValueOn(); value; ++value) {
        const openvdb::Coord at = value.getCoord();
        hash.add(at.x());
        hash.add(at.y());
        hash.add(at.z());
        hash.add(*value);
        golden.sum += sumOf(*value);
        ++golden.count;
    }
    golden.hash = hash.value();
    return golden;
}

Golden goldenOf(const LevelSet& levelSet)
{
    return goldenOf(levelSet.grid());
}

Golden goldenOf(const Mesh& mesh)
{
    Golden golden;
    Hash hash;
    for (const Vec3f& p : mesh.positions)
        for (const float x : p) hash.add(x);
    for (const Mesh::Triangle& t : mesh.triangles) {
        for (const std::uint32_t corner : t) hash.add(corner);
        golden.sum += (mesh.world(t[1]) - mesh.world(t[0]))
                          .cross(mesh.world(t[2]) - mesh.world(t[0]))
                          .norm() /
                      2;
    }
    golden.count = double(mesh.triangles.size());
    golden.hash = hash.value();
    return golden;
}

PointCloud scanned(const std::string& solid, ScanSettings::Pattern pattern, double noise)
{
    ScanSettings settings;
    settings.points = 3000;
    settings.pattern = pattern;
    settings.noise = noise;
    return test::scanOf(solid, settings);
}

ReconstructResult made(PointCloud cloud, Interrupter& progress,
                       const ReconstructOptions& settings = {})
{
    return reconstruct(std::move(cloud), settings, &progress);
}

LevelSet sampled(const std::string& solid, double voxelSize, Interrupter& progress)
{
    const FieldPtr field = makeSolidField(parseSolid(solid));
    SampleSettings settings;
    settings.lattice = latticeFor(field->bounds(), voxelSize);
    return sampleField(*field, settings, &progress);
}

using Case = std::function<Golden(Interrupter&)>;

/// The cases by name.
std::map<std::string, Case> cases()
{
    using Pattern = ScanSettings::Pattern;
    const auto ball = [](Interrupter& p) { return sampled("sphere(1)", 0.08, p); };
    const auto box = [](Interrupter& p) {
        return sampled("translate(box(1.2, 1, 1.4), 0.6, 0.3, 0)", 0.08, p);
    };
    const auto two = [=](Boolean kind, double radius) {
        return [=](Interrupter& p) {
            return goldenOf(combine(kind, {ball(p), box(p)}, radius, &p));
        };
    };
    return {
        {"reconstruct even",
         [](Interrupter& p) {
             return goldenOf(made(scanned("sphere(1)", Pattern::Even, 0), p).levelSet());
         }},
        {"reconstruct noisy",
         [](Interrupter& p) {
             return goldenOf(made(scanned("torus(1, 0.4)", Pattern::Random, 0.02), p).levelSet());
         }},
        {"reconstruct scans",
         [](Interrupter& p) {
             return goldenOf(made(scanned("blob(1, 8, 0.1)", Pattern::Scan, 0.005), p).levelSet());
         }},
        {"reconstruct edges",
         [](Interrupter& p) {
             return goldenOf(made(scanned("box(2, 1.4, 1)", Pattern::Even, 0), p).levelSet());
         }},
        {"reconstruct without normals",
         [](Interrupter& p) {
             PointCloud cloud = scanned("torus(1, 0.4)", Pattern::Even, 0.004);
             cloud.normals.clear();
             return goldenOf(made(std::move(cloud), p).levelSet());
         }},
        {"reconstruct interpolated",
         [](Interrupter& p) {
             ReconstructOptions settings;
             settings.interpolate = true;
             return goldenOf(
                 made(scanned("sphere(1)", Pattern::Random, 0), p, settings).levelSet());
         }},
        {"coverage",
         [](Interrupter& p) {
             ReconstructOptions settings;
             settings.coverage = true;
             return goldenOf(*made(scanned("sphere(1)", Pattern::Scan, 0), p, settings).coverage);
         }},
        {"colors",
         [](Interrupter& p) {
             PointCloud cloud = scanned("sphere(1)", Pattern::Random, 0);
             for (std::size_t n = 0; n < cloud.size(); ++n)
                 cloud.colors.push_back({std::uint8_t(n), std::uint8_t(n / 7), 200});
             ReconstructOptions settings;
             settings.attributes = {kColorName};
             const ReconstructResult r = made(std::move(cloud), p, settings);
             return goldenOf(*openvdb::gridPtrCast<openvdb::Vec3SGrid>(r.attributes.front()));
         }},
        {"voxelize",
         [](Interrupter& p) {
             Mesh one = test::ballPart(1, 8), other = test::ballPart(0.7, 8);
             test::move(other, Eigen::Matrix3d::Identity(), Vec3d(0.8, 0.1, 0));
             SampleSettings settings;
             settings.lattice = {Vec3d::Zero(), 0.08};
             return goldenOf(voxelize(test::soupOf({one, other}), settings, &p));
         }},
        {"union", two(Boolean::Union, 0)},
        {"intersection", two(Boolean::Intersection, 0)},
        {"difference", two(Boolean::Difference, 0)},
        {"blend", two(Boolean::Union, 0.3)},
        {"offset outward", [=](Interrupter& p) { return goldenOf(offset(box(p), 0.31, &p)); }},
        {"offset inward", [=](Interrupter& p) { return goldenOf(offset(box(p), -0.21, &p)); }},
        {"shell", [=](Interrupter& p) { return goldenOf(shell(ball(p), 0.25, Wall::Inward, &p)); }},
        {"smooth", [=](Interrupter& p) { return goldenOf(smooth(box(p), {}, &p)); }},
        {"morph",
         [=](Interrupter& p) {
             return goldenOf(morph(ball(p), box(p), 0.4, Morphing::Advection, &p));
         }},
        {"twist",
         [=](Interrupter& p) {
             const auto warp = makeTwist({Vec3d::Zero(), Vec3d::UnitZ()}, 0.8);
             const FieldPtr field =
                 makeWarpedField(makeSolidField(parseSolid("box(1, 0.6, 1.4)")), warp);
             SampleSettings settings;
             settings.lattice = latticeFor(field->bounds(), 0.08);
             return goldenOf(sampleField(*field, settings, &p));
         }},
        {"half-width", [=](Interrupter& p) { return goldenOf(withHalfWidth(box(p), 7, &p)); }},
        {"mesh",
         [=](Interrupter& p) {
             return goldenOf(
                 extractMesh(combine(Boolean::Difference, {ball(p), box(p)}, 0, &p), {}, &p));
         }},
        {"simplified mesh",
         [=](Interrupter& p) {
             SimplifySettings settings;
             settings.tolerance = 0.01;
             return goldenOf(simplify(extractMesh(ball(p), {}, &p), settings, &p));
         }},
    };
}

using File = std::map<std::string, Golden>;

File readFile()
{
    File file;
    std::ifstream in(MPUVDB_GOLDEN);
    std::string name;
    Golden golden;
    while (in >> std::quoted(name) >> std::hex >> golden.hash >> std::dec >> golden.count >>
           golden.sum)
        file[name] = golden;
    return file;
}

Golden resultOf(const Case& result, std::size_t threads)
{
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    Interrupter progress;
    return result(progress);
}

void renew(const File& before)
{
    std::ofstream out(MPUVDB_GOLDEN);
    out << std::setprecision(10);
    for (const auto& [name, result] : cases()) {
        const Golden now = resultOf(result, 1);
        out << std::quoted(name) << ' ' << std::hex << now.hash << std::dec << ' ' << now.count
            << ' ' << now.sum << '\n';
        const auto found = before.find(name);
        if (found == before.end())
            std::cout << name << ": new\n";
        else if (found->second.hash != now.hash)
            std::cout << name << ": count " << found->second.count << " to " << now.count
                      << ", sum " << found->second.sum << " to " << now.sum << '\n';
    }
}

TEST(Golden, NothingChanged)
{
    const File file = readFile();
    if (std::getenv("MPUVDB_RENEW_GOLDEN")) {
        renew(file);
        return;
    }
    EXPECT_EQ(file.size(), cases().size());
    for (const auto& [name, result] : cases()) {
        SCOPED_TRACE(name);
        const auto found = file.find(name);
        if (found == file.end()) {
            ADD_FAILURE() << "is not in " << MPUVDB_GOLDEN;
            continue;
        }
        for (const std::size_t threads : {std::size_t(1), std::size_t(4)}) {
            const Golden now = resultOf(result, threads);
            EXPECT_EQ(now.hash, found->second.hash)
                << threads << " threads: count " << found->second.count << " became " << now.count
                << ", sum " << found->second.sum << " became " << now.sum;
        }
    }
}

} // namespace
} // namespace mpuvdb
