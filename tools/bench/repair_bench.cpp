// What voxelize() makes of broken meshes, beside openvdb::tools::meshToVolume:
//     repair_bench VOXELS MESH...
// Prints a JSON line for each mesh, VOXELS long: why it is refused without repair, if it is; what
// was repaired (walls of four voxels of what encloses nothing), in how many seconds; what check()
// finds; and the largest error of values within a voxel of intact triangles, in voxels. A triangle
// is intact at places farther than three voxels from any rim, where it alone separates inside from
// outside. For the peer: its seconds, and the share of these voxels that have its sign and its
// distance to a hundredth of a voxel.
#include "spatial/nearest_place.h"
#include "spatial/point_triangle.h"
#include "spatial/triangle_tree.h"
#include <mpuvdb/error.h>
#include <mpuvdb/explained.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/io.h>
#include <mpuvdb/mesh.h>
#include <mpuvdb/sampling.h>

#include <nlohmann/json.hpp>
#include <openvdb/openvdb.h>
#include <openvdb/tools/Interpolation.h>
#include <openvdb/tools/MeshToVolume.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <map>

using namespace mpuvdb;

namespace
{

using Json = nlohmann::ordered_json;
using Corners = std::array<Vec3d, 3>;

constexpr double kAlone = 3, kNear = 1; ///< voxels
constexpr double kExact = 0.01;         ///< voxels

double secondsSince(std::chrono::steady_clock::time_point start)
{
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

Corners cornersOf(const TriangleTree& tree, std::size_t slot)
{
    const TriangleTree::Corners& t = tree.corners(slot);
    return {t[0].cast<double>(), t[1].cast<double>(), t[2].cast<double>()};
}

/// The edges that only one triangle has, as triangles without an area.
Mesh rimsOf(const Mesh& mesh)
{
    const auto key = [&](std::uint32_t v) {
        const Vec3f p = mesh.positions[v] + Vec3f::Zero();
        return std::array<float, 3>{p[0], p[1], p[2]};
    };
    std::map<std::array<std::array<float, 3>, 2>, int> uses;
    for (const Mesh::Triangle& t : mesh.triangles)
        for (std::size_t k = 0; k < 3; ++k) {
            std::array<std::array<float, 3>, 2> edge = {key(t[k]), key(t[(k + 1) % 3])};
            std::sort(edge.begin(), edge.end());
            ++uses[edge];
        }
    Mesh rims;
    for (const auto& [edge, count] : uses) {
        if (count % 2 == 0) continue;
        const auto first = std::uint32_t(rims.positions.size());
        for (const auto& p : edge) rims.positions.emplace_back(p[0], p[1], p[2]);
        rims.triangles.push_back({first, first + 1, first + 1});
    }
    return rims;
}

/// Whether the segment from @a a to @a b passes a triangle.
bool passes(const Corners& t, const Vec3d& a, const Vec3d& b)
{
    const Vec3d normal = (t[1] - t[0]).cross(t[2] - t[0]), along = b - a;
    if ((normal.dot(a - t[0]) > 0) == (normal.dot(b - t[0]) > 0)) return false;
    int left = 0;
    for (std::size_t k = 0; k < 3; ++k) left += along.dot((t[k] - a).cross(t[(k + 1) % 3] - a)) > 0;
    return left == 0 || left == 3;
}

/// Measures level sets of a mesh at its intact triangles.
class Intact
{
public:
    Intact(const Mesh& mesh, Interrupter& progress) : mFrame(mesh.frame), mTree(mesh, progress)
    {
        const Mesh rims = rimsOf(mesh);
        if (!rims.triangles.empty()) mRims = std::make_unique<TriangleTree>(rims, progress);
    }

    Json measure(const LevelSet& made, const openvdb::FloatGrid* peer) const
    {
        const double h = made.voxelSize();
        const Vec3d shift = made.lattice().origin - mFrame;
        const openvdb::tools::GridSampler<openvdb::FloatGrid, openvdb::tools::BoxSampler> at(
            made.grid());
        const auto isInside = [&](const Vec3d& p) {
            const Vec3d w = p + mFrame;
            return at.wsSample(openvdb::Vec3d(w[0], w[1], w[2])) < 0;
        };
        std::uint64_t measured = 0, ofPeer = 0;
        double largest = 0;
        Json worst;
        std::size_t slot = 0;
        for (auto on = made.grid().cbeginValueOn(); on; ++on) {
            const openvdb::Coord c = on.getCoord();
            const Vec3d p = h * Vec3d(c.x(), c.y(), c.z()) + shift;
            const double distance = std::sqrt(mTree.squaredDistance(p, slot));
            if (!(distance > 0.05 * h && distance < kNear * h)) continue; // nearer: no direction
            const Vec3d q = NearestPlace(p, cornersOf(mTree, slot)).place;
            const Vec3d reach = kAlone * h * (p - q).normalized();
            if (!isAlone(q, reach, h)) continue;
            const bool front = isInside(q + reach), back = isInside(q - reach);
            if (front == back || isInside(q + reach / 2) != front ||
                isInside(q - reach / 2) != back)
                continue;
            ++measured;
            const double error = std::abs(std::abs(double(*on)) - distance) / h;
            if (error > largest) {
                largest = error;
                const Vec3d x = p + mFrame;
                worst = {x[0], x[1], x[2]};
            }
            if (!peer) continue;
            const float value = peer->tree().getValue(c);
            ofPeer += (value < 0) == (*on < 0) &&
                      std::abs(std::abs(double(value)) - distance) < kExact * h;
        }
        Json json = {{"intact_voxels", measured}, {"largest_error", largest}, {"worst_at", worst}};
        if (peer && measured > 0) json["peer_right"] = double(ofPeer) / double(measured);
        return json;
    }

private:
    /// Whether no rim is near and no other triangle within reach of @a q.
    bool isAlone(const Vec3d& q, const Vec3d& reach, double h) const
    {
        std::size_t slot = 0;
        if (mRims && mRims->isWithin(q, kAlone * h, slot)) return false;
        slot = 0;
        bool isAlone = true;
        const auto normalOf = [&](std::size_t s) {
            const Corners t = cornersOf(mTree, s);
            return Vec3d((t[1] - t[0]).cross(t[2] - t[0]).normalized());
        };
        mTree.squaredDistance(q, slot);
        mTree.forEachNear(q, 1e-3 * h, [&](std::size_t s) { // such as face another way
            isAlone = isAlone && !(normalOf(s).dot(normalOf(slot)) < -0.9 &&
                                   squaredDistance(q, cornersOf(mTree, s)) < 1e-6 * h * h);
        });
        for (const double side : {-1, 1})
            mTree.forEachNear(q + side / 2 * reach, reach.norm() / 2, [&](std::size_t s) {
                isAlone = isAlone &&
                          !passes(cornersOf(mTree, s), q + side * 0.01 * reach, q + side * reach);
            });
        return isAlone;
    }

    Vec3d mFrame;
    TriangleTree mTree;
    std::unique_ptr<TriangleTree> mRims;
};

openvdb::FloatGrid::Ptr meshToVolume(const Mesh& mesh, double h)
{
    std::vector<openvdb::Vec3s> points;
    std::vector<openvdb::Vec3I> triangles;
    for (std::size_t v = 0; v < mesh.positions.size(); ++v) {
        const Vec3d p = mesh.world(v);
        points.emplace_back(p[0], p[1], p[2]);
    }
    for (const Mesh::Triangle& t : mesh.triangles) triangles.emplace_back(t[0], t[1], t[2]);
    return openvdb::tools::meshToLevelSet<openvdb::FloatGrid>(
        *openvdb::math::Transform::createLinearTransform(h), points, triangles, 3);
}

/// Surfaces that enclose nothing become walls four voxels thick.
LevelSet repaired(const Mesh& mesh, const SampleSettings& settings, Json& json,
                  Interrupter& progress)
{
    RepairSettings repair;
    try {
        return voxelize(mesh, settings, repair, &progress);
    } catch (const InputError& error) {
        json["unthickened"] = error.what();
    }
    repair.thickness = 4 * settings.lattice.voxelSize;
    return voxelize(mesh, settings, repair, &progress);
}

Json compare(const std::filesystem::path& path, double voxels)
{
    Json json = {{"mesh", path.filename().string()}};
    Interrupter progress;
    try {
        const Mesh mesh = readMesh(path, &progress);
        Box3d box;
        for (std::size_t v = 0; v < mesh.positions.size(); ++v) box.extend(mesh.world(v));
        SampleSettings settings;
        settings.lattice.voxelSize = box.sizes().maxCoeff() / voxels;
        json["triangles"] = mesh.triangles.size();
        try {
            const LevelSet sound = voxelize(mesh, settings, &progress);
            json["without"] = sound.explained()->isSound() ? "" : "unsound";
        } catch (const InputError& error) {
            json["without"] = error.what();
        }
        auto start = std::chrono::steady_clock::now();
        const LevelSet made = repaired(mesh, settings, json, progress);
        json["seconds"] = secondsSince(start);
        const auto& explained = std::get<MeshExplained>(made.explained()->by);
        const MeshRepair& repair = *explained.repair;
        json["holes"] = repair.holes;
        json["widest_hole"] = repair.widestHole / settings.lattice.voxelSize;
        json["turned"] = repair.turned;
        json["copies"] = repair.copies;
        json["findings"] = explained.findings;
        json["volume"] = explained.volumeOut;
        json["check"] = Json::array();
        for (const CheckFinding& finding : check(made.grid()).findings)
            json["check"].push_back(finding.what);
        start = std::chrono::steady_clock::now();
        const auto peer = meshToVolume(mesh, settings.lattice.voxelSize);
        json["peer_seconds"] = secondsSince(start);
        json.update(Intact(mesh, progress).measure(made, peer.get()));
    } catch (const std::exception& error) {
        json["refused"] = error.what();
    }
    return json;
}

} // namespace

int main(int count, char** arguments)
{
    if (count < 3) {
        std::fprintf(stderr, "usage: %s VOXELS MESH...\n", arguments[0]);
        return 2;
    }
    openvdb::initialize();
    for (int n = 2; n < count; ++n) {
        std::printf("%s\n", compare(arguments[n], std::atof(arguments[1])).dump().c_str());
        std::fflush(stdout);
    }
    return 0;
}
