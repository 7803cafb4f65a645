#include "face_patches.h"

#include <mpuvdb/interrupter.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <unordered_map>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;

constexpr int kNeighborRadius = 2; ///< neighborhood of a fit, voxels [tuned: offset_bench]
/// Smallest cosine of normals and largest height over the plane, voxels, for feet of one face.
/// [tuned: offset_bench]
constexpr float kFaceCosine = 0.9f, kFaceHeight = 0.5f;
/// Smallest cosine of normals and largest height over the plane, voxels, for feet of one plane.
/// [tuned: offset_bench]
constexpr float kPlaneCosine = 0.97f, kPlaneHeight = 0.15f;
/// Smallest number of other feet on a patch's plane. [tuned: offset_bench]
constexpr int kMinSupport = 3;
constexpr float kMaxCurvature = 0.3f; ///< largest curvature, per voxel [tuned: offset_bench]

/// Least-squares fit of a quadratic function to heights over a plane.
class Heights
{
public:
    using Coefficients = Eigen::Matrix<float, 6, 1>; ///< factors of 1, u, v, u^2/2, uv, v^2/2

    void add(float u, float v, float height)
    {
        Coefficients row;
        row << 1, u, v, 0.5f * u * u, u * v, 0.5f * v * v;
        mSquares += row * row.transpose();
        mPull += height * row;
        mSum += height * height;
        ++mCount;
    }

    /// False where heights are too few, or not those of a smooth surface.
    bool fit(Coefficients& h) const
    {
        /// Smallest number of heights, for six coefficients. [tuned: offset_bench]
        constexpr int kMinHeights = 9;
        constexpr float kDamping = 1e-3f; ///< ridge of the normal equations [tuned: offset_bench]
        constexpr float kMaxTilt = 0.2f;  ///< largest slope of the fit [tuned: offset_bench]
        /// Largest root mean square of the residuals, voxels. [tuned: offset_bench]
        constexpr float kMaxResidual = 0.02f;
        if (mCount < kMinHeights) return false;
        h = (mSquares + kDamping * Squares::Identity()).ldlt().solve(mPull);
        const float left = mSum - 2 * h.dot(mPull) + h.dot(mSquares * h);
        return left <= kMaxResidual * kMaxResidual * float(mCount) &&
               std::abs(h[0]) <= kFaceHeight && std::hypot(h[1], h[2]) <= kMaxTilt;
    }

private:
    using Squares = Eigen::Matrix<float, 6, 6>;
    Squares mSquares = Squares::Zero();
    Coefficients mPull = Coefficients::Zero();
    float mSum = 0;
    int mCount = 0;
};

/// A patch fitted to its face.
struct Fitted {
    SurfacePatch patch;
    int support = 0;       ///< other patches on its plane
    bool isSmooth = false; ///< the feet of its face around it lie on a quadric

    bool hasSupport() const { return support >= kMinSupport; }
    bool isOnFace() const { return isSmooth && hasSupport(); }
};

SurfacePatch withLimitedCurvature(SurfacePatch patch)
{
    for (float& k : patch.curvature) k = std::clamp(k, -kMaxCurvature, kMaxCurvature);
    return patch;
}

Fitted fitted(const CreaseZone& zone, VoxelNumbers& numbers, std::uint32_t number)
{
    Fitted made;
    SurfacePatch& patch = made.patch;
    patch = zone.patches().patches[number];
    const Vec3f across = patch.normal.cross(patch.tangent);
    Heights heights;
    for (int x = -kNeighborRadius; x <= kNeighborRadius; ++x)
        for (int y = -kNeighborRadius; y <= kNeighborRadius; ++y)
            for (int z = -kNeighborRadius; z <= kNeighborRadius; ++z) {
                const std::uint32_t n = numbers[patch.voxel.offsetBy(x, y, z)];
                if (n == VoxelIndex::kNone || zone.patches().kinds[n] == PatchKind::Rough) continue;
                const SurfacePatch& other = zone.patches().patches[n];
                const float cosine = patch.normal.dot(other.normal);
                if (!(cosine >= kFaceCosine)) continue;
                const Vec3f to = -other.to(patch.voxel) - patch.foot;
                const float height = patch.normal.dot(to);
                made.support +=
                    n != number && cosine >= kPlaneCosine && std::abs(height) <= kPlaneHeight;
                if (std::abs(height) <= kFaceHeight)
                    heights.add(patch.tangent.dot(to), across.dot(to), height);
            }
    Heights::Coefficients h;
    if (!heights.fit(h)) {
        patch = withLimitedCurvature(patch);
        return made;
    }
    const Vec3f t = patch.tangent;
    const Eigen::Matrix3f twist = t * across.transpose();
    patch.foot += h[0] * patch.normal;
    patch.normal = (patch.normal - h[1] * t - h[2] * across).normalized();
    patch.bend(-(h[3] * t * t.transpose() + h[4] * (twist + twist.transpose()) +
                 h[5] * across * across.transpose()),
               0);
    patch = withLimitedCurvature(patch);
    made.isSmooth = true;
    return made;
}

/// Leaves with enough patches on faces. Elsewhere details as fine as voxels look like creases, and
/// there are no faces to fit.
class LeafFaces
{
public:
    LeafFaces(const SurfacePatches& patches, const CreaseZone& zone,
              const std::vector<std::uint32_t>& numbers, const std::vector<Fitted>& made)
    {
        std::size_t next = 0;
        for (std::size_t leaf = 0; leaf < patches.leaves.size(); ++leaf) {
            const std::uint32_t end = patches.first[leaf + 1];
            Counts counts{0, zone.countBeside(patches.first[leaf], end)};
            for (; next < numbers.size() && numbers[next] < end; ++next)
                counts.onFaces += made[next].isOnFace();
            if (counts.beside > 0) addAbout(patches.leaves[leaf]->origin(), counts);
        }
    }

    bool areEnoughAt(const Coord& voxel) const
    {
        /// Share of the patches beside creases that lie on faces. [tuned: offset_bench]
        constexpr float kMinFaceShare = 0.4f;
        const auto found = mCounts.find(originOf(voxel));
        return found != mCounts.end() &&
               float(found->second.onFaces) >= kMinFaceShare * float(found->second.beside);
    }

private:
    struct Counts {
        std::size_t onFaces = 0, beside = 0;
    };
    static Coord originOf(const Coord& voxel) { return voxel & ~7; }

    /// Add counts to a leaf and those around it, where a corner may have most of its faces.
    void addAbout(const Coord& origin, const Counts& more)
    {
        for (int n = 0; n < 27; ++n) {
            Counts& counts =
                mCounts[origin.offsetBy(8 * (n / 9 - 1), 8 * (n / 3 % 3 - 1), 8 * (n % 3 - 1))];
            counts.onFaces += more.onFaces;
            counts.beside += more.beside;
        }
    }

    std::unordered_map<Coord, Counts> mCounts;
};

} // namespace

void fitToFaces(SurfacePatches& patches, CreaseZone& zone, Interrupter& progress)
{
    std::vector<std::uint32_t> numbers;
    for (std::uint32_t n = 0; n < patches.patches.size(); ++n)
        if (zone.isBeside(n) && patches.kinds[n] != PatchKind::Rough) numbers.push_back(n);
    std::vector<Fitted> made(numbers.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, numbers.size(), 64),
                      [&](const tbb::blocked_range<std::size_t>& range) {
                          progress.check();
                          VoxelNumbers around(zone.index());
                          for (std::size_t n = range.begin(); n < range.end(); ++n)
                              made[n] = fitted(zone, around, numbers[n]);
                      });
    const LeafFaces faces(patches, zone, numbers, made);
    for (std::size_t n = 0; n < numbers.size(); ++n) {
        if (!faces.areEnoughAt(patches.patches[numbers[n]].voxel)) continue;
        patches.patches[numbers[n]] = made[n].patch;
        if (!made[n].hasSupport()) patches.kinds[numbers[n]] = PatchKind::Rough;
    }
    for (std::size_t leaf = 0; leaf < patches.leaves.size(); ++leaf)
        if (!faces.areEnoughAt(patches.leaves[leaf]->origin()))
            zone.exclude(patches.first[leaf], patches.first[leaf + 1]);
}

} // namespace mpuvdb
