#include "sharp_surface.h"

#include "leaf_window.h"
#include "spatial/point_triangle.h"
#include <mpuvdb/interrupter.h>
#include <mpuvdb/mesh.h>

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

/// Distance, voxels, below which a place lies on the surface, and distances are equal. [derived:
/// roundings of doubles at 2^31 voxels]
constexpr double kOnSurface = 1e-6;

/// Of each vertex of @a mesh, whether the values about it are smooth.
std::vector<bool> smoothVertices(const Mesh& mesh, const LevelSet& levelSet, Interrupter& progress)
{
    const Lattice lattice = levelSet.lattice();
    std::vector<char> smooth(mesh.positions.size());
    tbb::enumerable_thread_specific<LeafWindow> windows(
        [&] { return LeafWindow(levelSet.grid().tree(), lattice.voxelSize); });
    // Vertices come leaf by leaf, so that a window serves many of them.
    constexpr std::size_t kVertices = 4096; // of a task [free: grain size]
    tbb::parallel_for(
        tbb::blocked_range<std::size_t>(0, smooth.size(), kVertices), [&](const auto& range) {
            progress.check();
            LeafWindow& window = windows.local();
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

} // namespace

SharpSurface::SharpSurface(const LevelSet& levelSet, const Field* field, Interrupter& progress)
    : mVoxelSize(levelSet.voxelSize()), mField(makeGridField(levelSet)),
      mMesh(extractMesh(levelSet, {field}, &progress)),
      mSmooth(smoothVertices(mMesh, levelSet, progress))
{
    mTree.emplace(mMesh, progress);
}

bool SharpSurface::isSmooth(std::size_t slot) const
{
    const Mesh::Triangle& triangle = mMesh.triangles[mTree->triangle(slot)];
    return std::all_of(triangle.begin(), triangle.end(), [&](auto v) { return mSmooth[v]; });
}

Vec3d SharpSurface::normalAt(std::size_t slot) const
{
    const auto& [a, b, c] = mTree->corners(slot);
    return (b - a).cast<double>().cross((c - a).cast<double>()).normalized();
}

/// Whether @a p, whose distance from the triangles is @a distance, is behind those that are
/// nearest: the one at @a slot where it lies straight below p, else by the normals of all weighted
/// with angles [Baerentzen05]. @param p  relative to the mesh's frame.
bool SharpSurface::isInside(const Vec3d& p, double distance, std::size_t slot) const
{
    const double farthest = distance + kOnSurface * mVoxelSize;
    const double height = normalAt(slot).dot(p - mTree->corners(slot)[0].cast<double>());
    if (std::abs(height) > distance - kOnSurface * mVoxelSize) return height < 0;
    double sum = 0;
    mTree->forEachNear(p, farthest, [&](std::size_t other) {
        std::array<Vec3d, 3> corners;
        for (std::size_t k = 0; k < 3; ++k) corners[k] = mTree->corners(other)[k].cast<double>();
        const NearestPlace near(p, corners);
        if ((p - near.place).squaredNorm() > farthest * farthest) return;
        sum += near.angle * normalAt(other).dot(p - near.place);
    });
    return sum < 0;
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
                                  std::size_t& slot) const
{
    const Vec3d from = p - mMesh.frame;
    const double apart = std::sqrt(mTree->squaredDistance(from, slot));
    std::array<Vec3d, 3> corners;
    for (std::size_t k = 0; k < 3; ++k) corners[k] = mTree->corners(slot)[k].cast<double>();
    const Vec3d place = mMesh.frame + NearestPlace(from, corners).place;
    if (isSmooth(slot)) {
        const std::optional<SurfaceFoot> foot = refined(p, place);
        // It may be farther than the triangle by as much as that lies off the zero set.
        if (foot && std::abs(foot->distance) < apart + 0.1 * mVoxelSize &&
            (!inside || *inside == (foot->distance < 0)))
            return *foot;
    }
    const double sign = (inside ? *inside : isInside(from, apart, slot)) ? -1 : 1;
    const bool on = apart < kOnSurface * mVoxelSize;
    return {place, on ? normalAt(slot) : Vec3d(sign * (p - place) / apart), sign * apart};
}

double SharpSurface::firstHit(const Vec3d& origin, const Vec3d& direction, Vec3d& normal) const
{
    std::size_t slot = 0;
    double t = mTree->firstHit(origin - mMesh.frame, direction, slot);
    if (!std::isfinite(t)) return t;
    normal = normalAt(slot);
    if (!isSmooth(slot)) return t;
    // A step of Newton's method to the zero set, unless the ray grazes it.
    const FieldSample sample = mField->evaluate(origin + t * direction);
    const double slope = sample.gradient.dot(direction);
    if (!(std::abs(slope) > 0.1 * sample.gradient.norm() * direction.norm())) return t;
    normal = sample.gradient.normalized();
    return std::max(0.0, t - sample.value / slope);
}

} // namespace mpuvdb
