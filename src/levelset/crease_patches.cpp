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
constexpr float kFarthest = 1.8f;    ///< of a crease from its voxel, voxels
constexpr float kFarthestFoot = 3;   ///< of a crease from the nearest foot beside it, voxels
constexpr float kOffSurface = 0.35f; ///< of a crease from the surface that the values tell, voxels
constexpr float kOffPlane = 0.1f;    ///< of a crease from the planes that meet there, voxels

class CreaseFinder
{
public:
    CreaseFinder(const SurfacePatches& patches, const openvdb::FloatTree& tree)
        : mPatches(patches), mTree(tree)
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
        if (!(gap < kFarthestFoot) || !isOnSurface(voxel, at)) return std::nullopt;
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

    /// The number of a voxel's patch, if it has one.
    std::optional<std::size_t> indexOf(const Coord& voxel) const
    {
        const auto found = mLeaves.find(voxel & ~7);
        if (found == mLeaves.end()) return std::nullopt;
        const auto begin = mPatches.patches.begin();
        const auto first = begin + mPatches.first[found->second],
                   last = begin + mPatches.first[found->second + 1];
        const auto at = std::lower_bound(
            first, last, Leaf::coordToOffset(voxel),
            [](const SurfacePatch& p, auto to) { return Leaf::coordToOffset(p.voxel) < to; });
        if (at == last || at->voxel != voxel) return std::nullopt;
        return std::size_t(at - begin);
    }

private:
    struct Plane {
        Vec3f point, normal;
    };

    /// Whether the values about @a offset from @a voxel allow the surface to be there: no corner of
    /// its cell is farther from the surface than from that place.
    bool isOnSurface(const Coord& voxel, const Vec3f& offset) const
    {
        const openvdb::tree::ValueAccessor<const openvdb::FloatTree> access(mTree);
        const Vec3f low = offset.array().floor();
        const Coord corner = voxel.offsetBy(int(low.x()), int(low.y()), int(low.z()));
        std::array<float, 8> values;
        float slope = 0; // of a distance by any scale
        for (int n = 0; n < 8; ++n) {
            values[std::size_t(n)] = access.getValue(corner.offsetBy(n >> 2, n >> 1 & 1, n & 1));
            for (const int axis : {1, 2, 4})
                if (n & axis)
                    slope = std::max(
                        slope, std::abs(values[std::size_t(n)] - values[std::size_t(n - axis)]));
        }
        for (int n = 0; n < 8; ++n) {
            const Vec3f from = low + Vec3f(float(n >> 2), float(n >> 1 & 1), float(n & 1)) - offset;
            if (!(std::abs(values[std::size_t(n)]) <= slope * (from.norm() + kOffSurface)))
                return false;
        }
        return true;
    }

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
        const auto n = indexOf(voxel);
        return n && mPatches.kinds[*n] != PatchKind::Rough ? &mPatches.patches[*n] : nullptr;
    }

    struct HashCoord {
        std::size_t operator()(const Coord& c) const { return c.hash<20>(); }
    };

    const SurfacePatches& mPatches;
    const openvdb::FloatTree& mTree;
    std::unordered_map<Coord, std::size_t, HashCoord> mLeaves;
};

} // namespace

void addCreasePatches(SurfacePatches& patches, const openvdb::FloatTree& tree, Progress& progress)
{
    std::vector<std::uint32_t> candidates;
    for (std::size_t n = 0; n < patches.kinds.size(); ++n)
        if (patches.kinds[n] != PatchKind::Smooth) candidates.push_back(std::uint32_t(n));
    if (candidates.empty()) return;
    const CreaseFinder finder(patches, tree);
    std::vector<std::optional<SurfacePatch>> found(candidates.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, candidates.size(), 64),
                      [&](const tbb::blocked_range<std::size_t>& range) {
                          progress.check();
                          for (std::size_t n = range.begin(); n < range.end(); ++n)
                              found[n] = finder.find(patches.patches[candidates[n]].voxel);
                      });
    for (const std::uint32_t candidate : candidates) {
        const Coord voxel = patches.patches[candidate].voxel;
        for (int n = 0; n < 27; ++n)
            if (const auto near =
                    finder.indexOf(voxel.offsetBy(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1)))
                patches.patches[*near].bounded = true;
    }
    for (const auto& patch : found)
        if (patch) patches.patches.push_back(*patch);
}

} // namespace mpuvdb
