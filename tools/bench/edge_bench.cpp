// How exact meshes of parts are near their edges, beside openvdb::tools::volumeToMesh:
//     edge_bench MESH [VOXELS [DEGREES]]
// of a closed mesh VOXELS long, whose creases are its edges of DEGREES and more. Two level sets of
// it are meshed: one reconstructed from exact points, two for each voxel that the surface passes,
// and the exact one of voxelize(). Prints JSON: rms distance to the part of what lies within two
// voxels of a crease, in voxels, and the mean angle between the normals of mesh and part, degrees.
#include "spatial/kd_tree.h"
#include "spatial/triangle_tree.h"
#include <mpuvdb/interrupter.h>
#include <mpuvdb/io.h>
#include <mpuvdb/mesh.h>
#include <mpuvdb/operations.h>
#include <mpuvdb/reconstruct.h>

#include <openvdb/openvdb.h>
#include <openvdb/tools/VolumeToMesh.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <map>
#include <random>
#include <stdexcept>

using namespace mpuvdb;

namespace
{

constexpr double kPi = 3.14159265358979323846;
constexpr std::size_t kPlaces = 400000; ///< on each mesh that is measured
constexpr double kNearCrease = 2;       ///< voxels

using Corners = std::array<Vec3d, 3>; ///< world units

Corners cornersOf(const Mesh& mesh, const Mesh::Triangle& t)
{
    return {mesh.world(t[0]), mesh.world(t[1]), mesh.world(t[2])};
}

/// As long as twice the area.
Vec3d normalOf(const Corners& c)
{
    return (c[1] - c[0]).cross(c[2] - c[0]);
}

struct Place {
    Vec3d position, normal;
};

/// Evenly over the area of a mesh, the same ones each time.
std::vector<Place> placesOn(const Mesh& mesh, std::size_t count)
{
    std::vector<double> areas;
    double sum = 0;
    for (const Mesh::Triangle& t : mesh.triangles)
        areas.push_back(sum += normalOf(cornersOf(mesh, t)).norm());
    std::mt19937_64 random(1);
    const auto uniform = [&] { return std::ldexp(double(random() >> 11), -53); };
    std::vector<Place> places;
    places.reserve(count);
    while (places.size() < count) {
        const auto found = std::upper_bound(areas.begin(), areas.end(), uniform() * sum);
        const auto t = std::min(std::size_t(found - areas.begin()), areas.size() - 1);
        const Corners c = cornersOf(mesh, mesh.triangles[t]);
        const double r = std::sqrt(uniform()), s = uniform();
        places.push_back(
            {(1 - r) * c[0] + r * (1 - s) * c[1] + r * s * c[2], normalOf(c).normalized()});
    }
    return places;
}

/// Points on the edges of @a mesh that turn by @a degrees and more, no farther apart than @a step;
/// relative to its frame.
std::vector<Vec3f> creasesOf(const Mesh& mesh, double degrees, double step)
{
    std::map<std::pair<std::uint32_t, std::uint32_t>, Vec3d> normals; // of the first side
    std::vector<Vec3f> points;
    for (const Mesh::Triangle& t : mesh.triangles) {
        const Vec3d normal = normalOf(cornersOf(mesh, t)).normalized();
        for (std::size_t side = 0; side < 3; ++side) {
            const std::uint32_t a = t[side], b = t[(side + 1) % 3];
            const auto [found, isFirst] = normals.emplace(std::minmax(a, b), normal);
            if (isFirst || found->second.dot(normal) > std::cos(degrees * kPi / 180)) continue;
            const Vec3f from = mesh.positions[a], along = mesh.positions[b] - from;
            const int steps = 1 + int(double(along.norm()) / step);
            for (int n = 0; n <= steps; ++n)
                points.push_back(from + float(n) / float(steps) * along);
        }
    }
    return points;
}

PointCloud pointsOn(const Mesh& mesh, double voxelSize)
{
    double area = 0;
    for (const Mesh::Triangle& t : mesh.triangles) area += normalOf(cornersOf(mesh, t)).norm() / 2;
    PointCloud cloud;
    cloud.frame = mesh.frame;
    for (const Place& place : placesOn(mesh, std::size_t(2 * area / (voxelSize * voxelSize)))) {
        cloud.positions.push_back((place.position - mesh.frame).cast<float>());
        cloud.normals.push_back(place.normal.cast<float>());
    }
    return cloud;
}

class Part
{
public:
    Part(const Mesh& mesh, double voxelSize, double degrees, Interrupter& progress)
        : mTree(mesh, progress), mFrame(mesh.frame), mVoxelSize(voxelSize),
          mCreases(creasesOf(mesh, degrees, 0.25 * voxelSize)), mCreaseTree(mCreases)
    {
        if (mCreases.empty()) throw std::runtime_error("the mesh has no such edges");
    }

    void print(const char* name, const Mesh& mesh) const
    {
        double squares = 0, angles = 0;
        std::size_t near = 0, slot = 0;
        for (const Place& place : placesOn(mesh, kPlaces)) {
            const Vec3d at = place.position - mFrame;
            const double distance2 = mTree.squaredDistance(at, slot);
            const TriangleTree::Corners& c = mTree.corners(slot);
            const Vec3f normal = (c[1] - c[0]).cross(c[2] - c[0]).normalized();
            angles += std::acos(std::clamp(place.normal.dot(normal.cast<double>()), -1., 1.));
            std::vector<std::uint32_t> index(1);
            std::vector<float> squared(1);
            mCreaseTree.nearest(at.cast<float>(), index, squared);
            if (std::sqrt(double(squared[0])) > kNearCrease * mVoxelSize) continue;
            squares += distance2;
            ++near;
        }
        std::printf("    \"%s\": {\"triangles\": %zu, \"near_creases\": %.4f, \"rms\": %.5f, "
                    "\"normal_degrees\": %.4f}",
                    name, mesh.triangles.size(), double(near) / double(kPlaces),
                    std::sqrt(squares / double(std::max<std::size_t>(near, 1))) / mVoxelSize,
                    angles / double(kPlaces) * 180 / kPi);
    }

private:
    TriangleTree mTree;
    Vec3d mFrame;
    double mVoxelSize;
    std::vector<Vec3f> mCreases;
    KdTree mCreaseTree;
};

Mesh volumeToMesh(const LevelSet& levelSet)
{
    std::vector<openvdb::Vec3s> points;
    std::vector<openvdb::Vec3I> triangles;
    std::vector<openvdb::Vec4I> quads;
    openvdb::tools::volumeToMesh(levelSet.grid(), points, triangles, quads);
    Mesh mesh;
    for (const openvdb::Vec3s& p : points) mesh.positions.emplace_back(p.x(), p.y(), p.z());
    for (const openvdb::Vec3I& t : triangles) mesh.triangles.push_back({t[0], t[2], t[1]});
    for (const openvdb::Vec4I& q : quads) { // clockwise
        mesh.triangles.push_back({q[0], q[2], q[1]});
        mesh.triangles.push_back({q[0], q[3], q[2]});
    }
    return mesh;
}

void compare(const char* path, double voxels, double degrees)
{
    Interrupter progress;
    const Mesh mesh = readMesh(path, &progress);
    Box3d box;
    for (std::size_t v = 0; v < mesh.positions.size(); ++v) box.extend(mesh.world(v));
    const double h = box.sizes().maxCoeff() / voxels;
    const Part part(mesh, h, degrees, progress);

    ReconstructOptions settings;
    settings.clean.reset();
    settings.voxelSize = Length{h};
    const ReconstructResult made = reconstruct(pointsOn(mesh, h), settings, &progress);
    std::printf("{\n  \"from_points\": {\n");
    part.print("with_field", extractMesh(made.levelSet(), {made.field.get()}, &progress));
    std::printf(",\n");
    part.print("grid_alone", extractMesh(made.levelSet(), {}, &progress));
    std::printf(",\n");
    part.print("volumeToMesh", volumeToMesh(made.levelSet()));

    SampleSettings sampling;
    sampling.lattice.voxelSize = h;
    const LevelSet exact = voxelize(mesh, sampling, &progress);
    std::printf("\n  },\n  \"voxelized\": {\n");
    part.print("grid_alone", extractMesh(exact, {}, &progress));
    std::printf(",\n");
    part.print("volumeToMesh", volumeToMesh(exact));
    std::printf("\n  }\n}\n");
}

} // namespace

int main(int count, char** arguments)
try {
    if (count < 2 || count > 4) {
        std::fprintf(stderr, "usage: %s MESH [VOXELS [DEGREES]]\n", arguments[0]);
        return 2;
    }
    openvdb::initialize();
    compare(arguments[1], count > 2 ? std::atof(arguments[2]) : 100,
            count > 3 ? std::atof(arguments[3]) : 30);
    return 0;
} catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
