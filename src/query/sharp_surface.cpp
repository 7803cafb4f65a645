#include "sharp_surface.h"

#include "band_window.h"
#include "grid/leaf_halo.h"
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/mesh.h>

#include <openvdb/tree/LeafManager.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <cmath>
#include <functional>

namespace mpuvdb
{
namespace
{

/// Distance, voxels, below which a place lies on the surface, and distances are equal. [derived:
/// roundings of doubles at 2^31 voxels]
constexpr double kOnSurface = 1e-6;
/// Distance, voxels, from the triangles within which the zero set is. [derived: the sagitta of an
/// edge of sqrt(3) voxels at a radius of four, below which it is not smooth]
constexpr double kOffSurface = 0.1;
/// Sine of the angle between rays and the surface below which they stop at the triangles. [derived:
/// the zero set, that far off, may be a voxel farther]
constexpr double kGrazing = kOffSurface;

/// Of each vertex of @a mesh, whether the values about it are smooth.
std::vector<bool> smoothVertices(const Mesh& mesh, const LevelSet& levelSet, Interrupter& progress)
{
    const Lattice lattice = levelSet.lattice();
    std::vector<char> smooth(mesh.positions.size());
    tbb::enumerable_thread_specific<BandWindow> windows(
        [&] { return BandWindow(levelSet.grid().tree(), lattice.voxelSize); });
    // Vertices come leaf by leaf, so that a window serves many of them.
    constexpr std::size_t kVertices = 4096; // of a task [free: grain size]
    tbb::parallel_for(
        tbb::blocked_range<std::size_t>(0, smooth.size(), kVertices), [&](const auto& range) {
            progress.check();
            BandWindow& window = windows.local();
            bool loaded = false;
            for (std::size_t v = range.begin(); v < range.end(); ++v) {
                const Vec3d at = (mesh.world(v) - lattice.origin) / lattice.voxelSize;
                const openvdb::Coord cell(int(std::floor(at[0])), int(std::floor(at[1])),
                                          int(std::floor(at[2])));
                const openvdb::Coord origin = cell & ~(kBlockDim - 1), in = cell - origin;
                if (!loaded || window.origin() != origin) window.load(origin);
                loaded = true;
                smooth[v] = window.isSmooth(in[0], in[1], in[2]);
            }
        });
    return std::vector<bool>(smooth.begin(), smooth.end());
}

/// The number of edges between voxels of the leaves, and up from them, whose ends differ in sign.
std::uint64_t crossedEdges(const openvdb::FloatTree& tree, const Interrupter& progress)
{
    using Window = BlockWindow<0, 1>;
    const openvdb::tree::LeafManager<const openvdb::FloatTree> leaves(tree);
    const auto inLeaf = [&](const openvdb::Coord& origin) {
        const openvdb::tree::ValueAccessor<const openvdb::FloatTree> access(tree);
        Window window;
        window.load(access, origin, 1);
        std::uint64_t edges = 0;
        for (int x = 0; x < kBlockDim; ++x)
            for (int y = 0; y < kBlockDim; ++y)
                for (int z = 0; z < kBlockDim; ++z) {
                    const int at = Window::index(x, y, z);
                    for (const int step : Window::kStride)
                        edges += (window[at] < 0) != (window[at + step] < 0);
                }
        return edges;
    };
    return tbb::parallel_reduce(
        leaves.leafRange(), std::uint64_t(0),
        [&](const auto& range, std::uint64_t edges) {
            progress.check();
            for (auto leaf = range.begin(); leaf; ++leaf) edges += inLeaf(leaf->origin());
            return edges;
        },
        std::plus<>());
}

Mesh meshOf(const LevelSet& levelSet, const Field* field, Interrupter& progress)
{
    Mesh mesh = extractMesh(levelSet, {field}, &progress);
    if (mesh.triangles.empty())
        throw InputError("the level set has no surface: nowhere does inside meet outside in its "
                         "band. Write it again from its source");
    return mesh;
}

} // namespace

std::uint64_t SharpSurface::bytesFor(const LevelSet& levelSet, const Interrupter& progress)
{
    // Two triangles for each edge between voxels that the surface crosses, and as many vertices as
    // edges, but for handles and parts.
    const std::uint64_t edges = crossedEdges(levelSet.grid().tree(), progress);
    return edges * (2 * sizeof(Mesh::Triangle) + sizeof(Vec3f)) + TriangleTree::bytesFor(2 * edges);
}

SharpSurface::SharpSurface(const LevelSet& levelSet, const Field* field, Interrupter& progress)
    : mVoxelSize(levelSet.voxelSize()), mField(makeGridField(levelSet)),
      mTriangles(meshOf(levelSet, field, progress), kOnSurface * mVoxelSize, progress),
      mSmooth(smoothVertices(mTriangles.mesh(), levelSet, progress))
{
}

bool SharpSurface::isSmooth(std::size_t slot) const
{
    const std::uint32_t index = mTriangles.tree().triangle(slot);
    const Mesh::Triangle& triangle = mTriangles.mesh().triangles[index];
    return std::all_of(triangle.begin(), triangle.end(), [&](auto v) { return mSmooth[v]; });
}

/// The foot of @a p on the zero set of cubic interpolation beside @a place, a place on a smooth
/// triangle; none where that is not the nearest one.
std::optional<SurfaceFoot> SharpSurface::refined(const Vec3d& p, const Vec3d& place) const
{
    struct OnSurface {
        Vec3d place, normal;
    };
    const auto project = [&](const Vec3d& from) {
        const FieldSample sample = mField->evaluate(from);
        const double slope = sample.gradient.norm();
        const Vec3d normal = sample.gradient / slope;
        return OnSurface{from - sample.value / slope * normal, normal};
    };
    OnSurface foot = project(place);
    double distance = (p - foot.place).dot(foot.normal);
    const Vec3d beside = p - foot.place - distance * foot.normal;
    const double length = beside.norm();
    if (length > kOnSurface * mVoxelSize) {
        // One step of Newton's method along the surface, with its curvature in that direction.
        const Vec3d along = beside / length;
        const double step = mVoxelSize / 2; // [derived: a triangle's size]
        const double curvature =
            (project(foot.place + step * along).normal - foot.normal).dot(along) / step;
        const double stretch = 1 + curvature * distance;
        // A foot is at most a triangle away; else p is near the center of curvature.
        if (!(length < mVoxelSize * stretch)) return {};
        foot = project(foot.place + length / stretch * along);
        distance = std::copysign((p - foot.place).norm(), distance);
    }
    if (!std::isfinite(distance)) return {};
    const bool on = std::abs(distance) < kOnSurface * mVoxelSize;
    return SurfaceFoot{foot.place, on ? foot.normal : Vec3d((p - foot.place) / distance), distance};
}

SurfaceFoot SharpSurface::nearest(const Vec3d& p, std::optional<bool> inside,
                                  const SignedTriangles::Near& near) const
{
    if (isSmooth(near.slot)) {
        const std::optional<SurfaceFoot> foot = refined(p, near.place);
        // It may be farther than the triangle by as much as that lies off the zero set.
        if (foot && std::abs(foot->distance) < near.distance + kOffSurface * mVoxelSize &&
            (!inside || *inside == (foot->distance < 0)))
            return *foot;
    }
    const double sign = (inside ? *inside : mTriangles.isBehind(p, near)) ? -1 : 1;
    const bool on = near.distance < kOnSurface * mVoxelSize;
    return {near.place,
            on ? mTriangles.normal(near.slot) : Vec3d(sign * (p - near.place) / near.distance),
            sign * near.distance};
}

double SharpSurface::firstHit(const Vec3d& origin, const Vec3d& direction, Vec3d& normal) const
{
    std::size_t slot = 0;
    const double t = mTriangles.tree().firstHit(origin - mTriangles.mesh().frame, direction, slot);
    if (!std::isfinite(t)) return t;
    normal = mTriangles.normal(slot);
    if (!isSmooth(slot)) return t;
    // A step of Newton's method to the zero set, unless the ray grazes it.
    const FieldSample sample = mField->evaluate(origin + t * direction);
    const double slope = sample.gradient.dot(direction);
    if (!(std::abs(slope) > kGrazing * sample.gradient.norm() * direction.norm())) return t;
    normal = sample.gradient.normalized();
    return std::max(0.0, t - sample.value / slope);
}

} // namespace mpuvdb
