#include "spatial/triangle_tree.h"

#include "spatial/kd_tree.h"
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/mesh.h>

#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

namespace mpuvdb
{
namespace
{

/// The largest number of places on a mesh. [tuned: mesh_measures_test]
constexpr std::size_t kSamples = 500000;
/// The least distance of two such places, diagonals of both meshes. [derived: an error is given to
/// four digits at most, and distances of nearer places differ by less]
constexpr double kApart = 1e-4;
/// The number of places that are summed at once. [tuned: time; it changes the sums' rounding alone]
constexpr std::size_t kBlock = 1024;

/// A number in [0,1) for each @a n [Steele14].
double uniform(std::uint64_t n)
{
    n = (n ^ n >> 30) * 0xbf58476d1ce4e5b9;
    n = (n ^ n >> 27) * 0x94d049bb133111eb;
    return double((n ^ n >> 31) >> 11) * 0x1p-53;
}

/// The part of a triangle, of @a share of its area at most, where a curve through all of it
/// (Sierpinski's) is when it has passed the share @a done, in [0, 1): parts that follow each other
/// are near each other.
std::array<Vec3d, 3> partOnCurve(const TriangleTree::Corners& corners, double done, double share)
{
    Vec3d from = corners[0].cast<double>(), apex = corners[1].cast<double>(),
          to = corners[2].cast<double>();
    double left = 1;
    while (left > share) {
        left /= 2;
        const Vec3d middle = (from + to) / 2;
        done *= 2;
        (done < 1 ? to : from) = apex;
        if (done >= 1) done -= 1;
        apex = middle;
    }
    return {from, apex, to};
}

/// Random places on a mesh, one in each of size() equal parts of its area, in the tree's order.
class Samples
{
public:
    /// @param apart  least distance of two places, world units.
    Samples(const Mesh& mesh, const TriangleTree& tree, double apart) : mMesh(mesh), mTree(tree)
    {
        mAreas.reserve(tree.size());
        double sum = 0;
        for (std::size_t slot = 0; slot < tree.size(); ++slot) {
            const auto& [a, b, c] = tree.corners(slot);
            sum += (b - a).cast<double>().cross((c - a).cast<double>()).norm();
            mAreas.push_back(sum);
        }
        const double most = sum / 2 / (apart * apart);
        mSize = most < double(kSamples) ? std::max(std::size_t(most), std::size_t(1)) : kSamples;
    }

    std::size_t size() const { return mSize; }
    /// World position of sample @a n.
    Vec3d operator()(std::size_t n) const
    {
        constexpr std::uint64_t kStep = 0x9e3779b97f4a7c15; // of SplitMix64 [paper: Steele14]
        const std::uint64_t seed = kStep * (3 * n + 1);
        const double share = mAreas.back() / double(mSize),
                     area = share * (double(n) + uniform(seed));
        const auto found = std::upper_bound(mAreas.begin(), mAreas.end(), area);
        const auto slot = std::min(std::size_t(found - mAreas.begin()), mAreas.size() - 1);
        const double before = slot > 0 ? mAreas[slot - 1] : 0, own = mAreas[slot] - before;
        const double done = own > 0 ? (area - before) / own : 0;
        const auto [a, b, c] = partOnCurve(mTree.corners(slot), done, own > 0 ? share / own : 1);
        const double r = std::sqrt(uniform(seed + kStep)), s = uniform(seed + 2 * kStep);
        return mMesh.frame + (1 - r) * a + r * (1 - s) * b + r * s * c;
    }

private:
    const Mesh& mMesh;
    const TriangleTree& mTree;
    std::vector<double> mAreas; ///< doubled, up to and with each slot
    std::size_t mSize = 0;
};

/// The vertices that triangles use, in the tree's order.
std::vector<std::uint32_t> verticesInOrder(const Mesh& mesh, const TriangleTree& tree)
{
    std::vector<std::uint32_t> order;
    std::vector<bool> seen(mesh.positions.size());
    for (std::size_t slot = 0; slot < tree.size(); ++slot)
        for (const std::uint32_t v : mesh.triangles[tree.triangle(slot)]) {
            if (!seen[v]) order.push_back(v);
            seen[v] = true;
        }
    return order;
}

struct Sums {
    double distance = 0, squared = 0, largest2 = 0;

    Sums operator+(const Sums& other) const
    {
        return {distance + other.distance, squared + other.squared,
                std::max(largest2, other.largest2)};
    }
};

/// The sums over the distances of @a count places. @a place(n) is a world position; @a measure()
/// makes, for a block, a function from a world position to its squared distance.
template <class Place, class Measure>
Sums sumOver(std::size_t count, const Place& place, const Measure& measure, Interrupter& progress)
{
    return tbb::parallel_deterministic_reduce(
        tbb::blocked_range<std::size_t>(0, count, kBlock), Sums(),
        [&](const tbb::blocked_range<std::size_t>& range, Sums sums) {
            progress.check();
            auto squaredDistance = measure();
            for (std::size_t n = range.begin(); n < range.end(); ++n) {
                const double d2 = squaredDistance(place(n));
                sums = sums + Sums{std::sqrt(d2), d2, d2};
            }
            progress.advance(double(range.size()));
            return sums;
        },
        [](const Sums& a, const Sums& b) { return a + b; });
}

/// Squared distances to a mesh; each search starts where the last one ended.
auto toMesh(const Mesh& mesh, const TriangleTree& tree)
{
    return [&mesh, &tree] {
        return [&mesh, &tree, slot = std::size_t(0)](const Vec3d& p) mutable {
            return tree.squaredDistance(p - mesh.frame, slot);
        };
    };
}

auto toPoints(const PointCloud& points, const KdTree& tree)
{
    return [&points, &tree] {
        return [&points, &tree, index = std::vector<std::uint32_t>(1),
                squared = std::vector<float>(1)](const Vec3d& p) mutable {
            tree.nearest((p - points.frame).cast<float>(), index, squared);
            return (points.world(index[0]) - p).squaredNorm();
        };
    };
}

/// Distances from places on @a mesh. @param diagonal  of both, world units.
template <class Measure>
Distances fromMesh(const Mesh& mesh, const TriangleTree& tree, double diagonal,
                   const Measure& measure, Interrupter& progress)
{
    const Samples samples(mesh, tree, kApart * diagonal);
    const Sums sums = sumOver(samples.size(), samples, measure, progress);
    const std::vector<std::uint32_t> vertices = verticesInOrder(mesh, tree);
    const Sums corners = sumOver(
        vertices.size(), [&](std::size_t n) { return mesh.world(vertices[n]); }, measure, progress);
    const auto count = double(samples.size());
    return {sums.distance / count, std::sqrt(sums.squared / count),
            std::sqrt(std::max(sums.largest2, corners.largest2))};
}

Box3d boxOf(const Mesh& mesh, const TriangleTree& tree)
{
    return Box3d(tree.box().cast<double>()).translated(mesh.frame);
}

void requireTriangles(const Mesh& mesh)
{
    if (mesh.triangles.empty())
        throw UsageError("distances: the mesh has no triangles. Give a mesh that has some");
}

} // namespace

TwoWayDistances distances(const Mesh& mesh, const Mesh& other, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    requireTriangles(mesh);
    requireTriangles(other);
    progress.beginStage("distances", 2.0 * kSamples + double(mesh.positions.size()) +
                                         double(other.positions.size()));
    const TriangleTree first(mesh, progress), second(other, progress);
    const double diagonal = boxOf(mesh, first).merged(boxOf(other, second)).diagonal().norm();
    const TwoWayDistances result = {
        fromMesh(mesh, first, diagonal, toMesh(other, second), progress),
        fromMesh(other, second, diagonal, toMesh(mesh, first), progress)};
    progress.endStage();
    return result;
}

TwoWayDistances distances(const Mesh& mesh, const PointCloud& points, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    requireTriangles(mesh);
    if (points.empty()) throw UsageError("distances: there are no points. Give at least one");
    progress.beginStage("distances",
                        double(kSamples + mesh.positions.size()) + double(points.size()));
    const TriangleTree triangles(mesh, progress);
    const KdTree tree(points.positions);
    TwoWayDistances result;
    const Box3d box = boxOf(mesh, triangles).merged(points.localBounds().translated(points.frame));
    result.there =
        fromMesh(mesh, triangles, box.diagonal().norm(), toPoints(points, tree), progress);
    const Sums sums = sumOver(
        points.size(), [&](std::size_t n) { return points.world(n); }, toMesh(mesh, triangles),
        progress);
    const double count = double(points.size());
    result.back = {sums.distance / count, std::sqrt(sums.squared / count),
                   std::sqrt(sums.largest2)};
    progress.endStage();
    return result;
}

} // namespace mpuvdb
