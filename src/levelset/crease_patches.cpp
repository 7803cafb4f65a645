#include "crease_patches.h"

#include <mpuvdb/progress.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <optional>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <unordered_map>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using Leaf = SurfacePatches::Leaf;

/// Of the planes' normals, squared and summed: what spans a direction, relative to the largest.
constexpr float kLeastSpread = 0.04f;
constexpr float kFarthest = 1.8f;  ///< of a crease from its voxel, voxels
constexpr float kFarthestFoot = 1; ///< of a crease from the nearest foot beside it, voxels
constexpr float kOffPlane = 0.1f;  ///< of a crease from the planes that meet there, voxels

class CreaseFinder
{
public:
    explicit CreaseFinder(const SurfacePatches& patches) : mPatches(patches)
    {
        for (std::size_t n = 0; n < patches.leaves.size(); ++n)
            if (patches.first[n] < patches.first[n + 1])
                mLeaves.emplace(patches.leaves[n]->origin(), n);
    }

    /// The crease beside a voxel, if there is one.
    std::optional<SurfacePatch> find(const Coord& voxel) const
    {
        std::array<Plane, 27> planes;
        const int count = collect(voxel, planes);
        if (count < 2) return std::nullopt;
        Vec3f mean = Vec3f::Zero(), normal = Vec3f::Zero();
        for (int n = 0; n < count; ++n) {
            mean += planes[n].point / float(count);
            normal += planes[n].normal;
        }
        if (!(normal.norm() > 0.1f * float(count))) return std::nullopt;
        Eigen::Matrix3f spread = Eigen::Matrix3f::Zero();
        Vec3f pull = Vec3f::Zero();
        for (int n = 0; n < count; ++n) {
            const Plane& p = planes[n];
            spread += p.normal * p.normal.transpose();
            pull += p.normal * p.normal.dot(p.point - mean);
        }
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix3f> solver;
        solver.computeDirect(spread); // ascending
        const Vec3f size = solver.eigenvalues();
        const float least = kLeastSpread * size[2];
        if (!(size[1] > least)) return std::nullopt;
        const bool corner = size[0] > least;
        Vec3f at = mean;
        for (int n = corner ? 0 : 1; n < 3; ++n) {
            const Vec3f direction = solver.eigenvectors().col(n);
            at += direction * (direction.dot(pull) / size[n]);
        }
        if (!(at.norm() <= kFarthest)) return std::nullopt;
        float gap = kFarthestFoot;
        for (int n = 0; n < count; ++n) {
            const Vec3f from = at - planes[n].point;
            if (!(std::abs(planes[n].normal.dot(from)) <= kOffPlane)) return std::nullopt;
            gap = std::min(gap, from.norm());
        }
        if (!(gap < kFarthestFoot)) return std::nullopt;
        const Vec3f along = solver.eigenvectors().col(0).normalized();
        SurfacePatch patch;
        patch.voxel = voxel;
        patch.foot = at;
        patch.tangent = corner ? normal.unitOrthogonal() : Vec3f(along.cross(normal).normalized());
        patch.normal = corner ? normal.normalized() : Vec3f(patch.tangent.cross(along));
        patch.curvature[0] = kPointCurvature;
        patch.curvature[1] = corner ? kPointCurvature : 0;
        return patch;
    }

private:
    struct Plane {
        Vec3f point, normal;
    };

    /// The planes of the voxel and those around, relative to it.
    int collect(const Coord& voxel, std::array<Plane, 27>& planes) const
    {
        int count = 0;
        for (int n = 0; n < 27; ++n) {
            const Coord side(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1);
            const SurfacePatch* const patch = patchOf(voxel + side);
            if (!patch) continue;
            const Vec3f point = patch->foot + Vec3f(float(side[0]), float(side[1]), float(side[2]));
            planes[std::size_t(count++)] = {point, patch->normal};
        }
        return count;
    }

    /// A voxel's patch, unless it is rough.
    const SurfacePatch* patchOf(const Coord& voxel) const
    {
        const auto found = mLeaves.find(voxel & ~7);
        if (found == mLeaves.end()) return nullptr;
        const auto begin = mPatches.patches.begin();
        const auto first = begin + mPatches.first[found->second],
                   last = begin + mPatches.first[found->second + 1];
        const auto at = std::lower_bound(
            first, last, Leaf::coordToOffset(voxel),
            [](const SurfacePatch& p, auto to) { return Leaf::coordToOffset(p.voxel) < to; });
        if (at == last || at->voxel != voxel) return nullptr;
        return mPatches.kinds[std::size_t(at - begin)] == PatchKind::Rough ? nullptr : &*at;
    }

    struct HashCoord {
        std::size_t operator()(const Coord& c) const { return c.hash<20>(); }
    };

    const SurfacePatches& mPatches;
    std::unordered_map<Coord, std::size_t, HashCoord> mLeaves;
};

} // namespace

void addCreasePatches(SurfacePatches& patches, Progress& progress)
{
    std::vector<std::uint32_t> candidates;
    for (std::size_t n = 0; n < patches.kinds.size(); ++n)
        if (patches.kinds[n] != PatchKind::Smooth) candidates.push_back(std::uint32_t(n));
    if (candidates.empty()) return;
    const CreaseFinder finder(patches);
    std::vector<std::optional<SurfacePatch>> found(candidates.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, candidates.size(), 64),
                      [&](const tbb::blocked_range<std::size_t>& range) {
                          progress.check();
                          for (std::size_t n = range.begin(); n < range.end(); ++n)
                              found[n] = finder.find(patches.patches[candidates[n]].voxel);
                      });
    for (const auto& patch : found)
        if (patch) patches.patches.push_back(*patch);
}

} // namespace mpuvdb
