// How faithful meshes are to what they were made from:
//     fidelity_measure solid DESCRIPTION MESH...
//     fidelity_measure mesh NAME TRUTH.ply MESH...
// of a solid of the virtual scanner's, or of the validation set, whose mesh validate_clouds wrote.
// Prints JSON: distances from mesh to truth ("there") and from truth to mesh ("back"), rms and
// largest, in parts of the diagonal of the truth's box; angles between the normals of the mesh's
// triangles and those of the truth's nearest places, degrees; components, genus, open edges.
// Distances to Booleans of the virtual scanner's are lower bounds beside their concave edges.
#include "validate_solids.h"

#include "spatial/triangle_tree.h"
#include <mpuvdb/interrupter.h>
#include <mpuvdb/io.h>
#include <mpuvdb/mesh.h>
#include <mpuvdb/scan_sampler.h>

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <exception>
#include <memory>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

using namespace mpuvdb;

namespace
{

constexpr double kDegrees = 180 / 3.14159265358979323846;
constexpr std::size_t kPlaces = 50000; ///< on each surface

Vec3d crossOf(const Mesh& mesh, const Mesh::Triangle& t)
{
    const Vec3d a = mesh.world(t[0]);
    return (mesh.world(t[1]) - a).cross(mesh.world(t[2]) - a);
}

struct Place {
    Vec3d position, normal;
};

/// Evenly over the area of a mesh, the same ones each time.
std::vector<Place> placesOn(const Mesh& mesh)
{
    std::vector<double> areas;
    double sum = 0;
    for (const Mesh::Triangle& t : mesh.triangles) areas.push_back(sum += crossOf(mesh, t).norm());
    std::mt19937_64 random(1);
    const auto uniform = [&] { return std::ldexp(double(random() >> 11), -53); };
    std::vector<Place> places;
    while (places.size() < kPlaces) {
        const auto found = std::upper_bound(areas.begin(), areas.end(), uniform() * sum);
        const std::size_t n = std::min(std::size_t(found - areas.begin()), areas.size() - 1);
        const Mesh::Triangle& t = mesh.triangles[n];
        const double r = std::sqrt(uniform()), s = uniform();
        places.push_back(
            {(1 - r) * mesh.world(t[0]) + r * (1 - s) * mesh.world(t[1]) + r * s * mesh.world(t[2]),
             crossOf(mesh, t).normalized()});
    }
    return places;
}

/// What a place is held against.
struct Nearest {
    double distance = 0; ///< world units
    Vec3d normal;        ///< of the truth, outward
};

class Truth
{
public:
    virtual ~Truth() = default;
    virtual Nearest nearest(const Vec3d& p) const = 0;
    /// Nearly the distance, and cheaper.
    virtual double about(const Vec3d& p) const = 0;
    /// Evenly over the area.
    virtual std::vector<Vec3d> places(Interrupter& progress) const = 0;
    virtual double diagonal() const = 0;
};

/// A solid of the virtual scanner's.
class SolidTruth final : public Truth
{
public:
    explicit SolidTruth(const std::string& description) : mSolid(parseSolid(description)) {}
    Nearest nearest(const Vec3d& p) const override
    {
        return {std::abs(mSolid->distance(p)), mSolid->normal(p)};
    }
    double about(const Vec3d& p) const override { return std::abs(mSolid->distance(p)); }
    std::vector<Vec3d> places(Interrupter& progress) const override
    {
        ScanSettings settings;
        settings.points = kPlaces;
        settings.pattern = ScanSettings::Pattern::Random;
        const PointCloud cloud = scan(*mSolid, settings, &progress);
        std::vector<Vec3d> places;
        for (std::size_t i = 0; i < cloud.size(); ++i) places.push_back(cloud.world(i));
        return places;
    }
    double diagonal() const override { return mSolid->bounds().diagonal().norm(); }

private:
    std::shared_ptr<const Solid> mSolid;
};

/// A solid of the validation set: its mesh tells where it is, and, if it is smooth, its function
/// where exactly.
class MeshTruth final : public Truth
{
public:
    MeshTruth(const std::string& name, const std::string& file, Interrupter& progress)
        : mImplicit(validate::makeImplicit(name)), mMesh(readMesh(file, &progress)),
          mTree(mMesh, progress)
    {
        Box3d box;
        for (std::size_t i = 0; i < mMesh.positions.size(); ++i) box.extend(mMesh.world(i));
        mDiagonal = box.diagonal().norm();
    }

    Nearest nearest(const Vec3d& p) const override
    {
        std::size_t slot = 0;
        const double distance = std::sqrt(mTree.squaredDistance(p - mMesh.frame, slot));
        // A facet is off the surface by less than a thousandth; far away that does not matter.
        if (mImplicit && distance < 0.01 * mDiagonal) {
            const Vec3d foot = mImplicit->foot(p);
            const double exact = (foot - p).norm();
            if (std::abs(exact - distance) < 0.001 * mDiagonal)
                return {exact, mImplicit->gradient(foot).normalized()};
        }
        return {distance, crossOf(mMesh, mMesh.triangles[mTree.triangle(slot)]).normalized()};
    }

    double about(const Vec3d& p) const override
    {
        std::size_t slot = 0;
        return std::sqrt(mTree.squaredDistance(p - mMesh.frame, slot));
    }

    std::vector<Vec3d> places(Interrupter&) const override
    {
        std::vector<Vec3d> result;
        for (const Place& p : placesOn(mMesh))
            result.push_back(mImplicit ? mImplicit->project(p.position) : p.position);
        return result;
    }
    double diagonal() const override { return mDiagonal; }

private:
    std::shared_ptr<const validate::Implicit> mImplicit;
    Mesh mMesh;
    TriangleTree mTree;
    double mDiagonal = 0;
};

struct Spread {
    double mean = 0, rms = 0, max = 0;
};

Spread spreadOf(const std::vector<double>& values)
{
    Spread spread;
    for (const double v : values) {
        spread.mean += v / double(values.size());
        spread.rms += v * v / double(values.size());
        spread.max = std::max(spread.max, v);
    }
    spread.rms = std::sqrt(spread.rms);
    return spread;
}

/// f(n) of all n, in order.
template <typename F>
std::vector<double> each(std::size_t count, const F& f)
{
    std::vector<double> values(count);
    tbb::parallel_for(std::size_t(0), count, [&](std::size_t n) { values[n] = f(n); });
    return values;
}

std::string measured(const Mesh& mesh, const Truth& truth, const std::vector<Vec3d>& truthPlaces,
                     Interrupter& progress)
{
    const std::vector<Place> places = placesOn(mesh);
    std::vector<double> angles(places.size());
    const auto distances = each(places.size(), [&](std::size_t n) {
        const Nearest nearest = truth.nearest(places[n].position);
        const Vec3d& normal = places[n].normal;
        angles[n] =
            kDegrees * std::atan2(normal.cross(nearest.normal).norm(), normal.dot(nearest.normal));
        return nearest.distance;
    });
    // Vertices stand out the most.
    const auto corners =
        each(mesh.positions.size(), [&](std::size_t n) { return truth.about(mesh.world(n)); });
    const auto outmost = std::max_element(corners.begin(), corners.end()) - corners.begin();
    const double farthest = truth.nearest(mesh.world(std::size_t(outmost))).distance;
    const TriangleTree tree(mesh, progress);
    const auto ways = each(truthPlaces.size(), [&](std::size_t n) {
        std::size_t slot = 0;
        return std::sqrt(tree.squaredDistance(truthPlaces[n] - mesh.frame, slot));
    });
    const double unit = truth.diagonal();
    const Spread there = spreadOf(distances), back = spreadOf(ways), turned = spreadOf(angles);
    const MeshReport report = measure(mesh);
    return fmt::format(
        R"({{"there": {{"rms": {:.4g}, "max": {:.4g}}}, "back": {{"rms": {:.4g}, "max": {:.4g}}}, )"
        R"("normals": {{"mean": {:.4g}, "rms": {:.4g}}}, "components": {}, "genus": {}, )"
        R"("open_edges": {}, "triangles": {}}})",
        there.rms / unit, std::max(there.max, farthest) / unit, back.rms / unit, back.max / unit,
        turned.mean, turned.rms, report.components, report.genus, report.boundaryEdges,
        report.triangles);
}

void run(const std::vector<std::string>& words)
{
    Interrupter progress;
    std::unique_ptr<Truth> truth;
    std::size_t first = 0; // of the meshes
    std::string topology;
    if (words.size() > 1 && words[0] == "solid") {
        truth = std::make_unique<SolidTruth>(words[1]);
        first = 2;
    } else if (words.size() > 2 && words[0] == "mesh") {
        truth = std::make_unique<MeshTruth>(words[1], words[2], progress);
        const MeshReport report = measure(readMesh(words[2], &progress));
        topology =
            fmt::format(R"("components": {}, "genus": {}, )", report.components, report.genus);
        first = 3;
    } else {
        throw std::runtime_error("give solid DESCRIPTION MESH..., or mesh NAME TRUTH.ply MESH...");
    }
    const std::vector<Vec3d> places = truth->places(progress);
    fmt::print("{{{}\"diagonal\": {:.9g}, \"meshes\": [\n", topology, truth->diagonal());
    for (std::size_t n = first; n < words.size(); ++n)
        fmt::print("  {}{}\n", measured(readMesh(words[n], &progress), *truth, places, progress),
                   n + 1 < words.size() ? "," : "");
    fmt::print("]}}\n");
}

} // namespace

int main(int argc, char** argv)
{
    try {
        run({argv + 1, argv + argc});
    } catch (const std::exception& error) {
        fmt::print(stderr, "fidelity_measure: {}\n", error.what());
        return 1;
    }
}
