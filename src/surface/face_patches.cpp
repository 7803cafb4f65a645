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

constexpr int kAround = 2; ///< voxels about one whose patches are looked at
/// Places of one face: the cosine of their normals, and the height of one over the other's plane.
constexpr float kSameFace = 0.9f, kOffFace = 0.5f;
/// And of one plane, on which there are to be so many others.
constexpr float kSamePlane = 0.97f, kOffPlane = 0.15f;
constexpr int kLeastSupport = 3;
constexpr float kMostBend = 0.3f; ///< per voxel

/// Heights of places above a plane, as a quadratic function.
class Heights
{
public:
    using Coefficients = Eigen::Matrix<float, 6, 1>; ///< of 1, u, v, u^2/2, uv, v^2/2

    void add(float u, float v, float height)
    {
        Coefficients row;
        row << 1, u, v, 0.5f * u * u, u * v, 0.5f * v * v;
        mSquares += row * row.transpose();
        mPull += height * row;
        mSum += height * height;
        ++mCount;
    }

    /// False where there are too few, or they are no smooth surface.
    bool fit(Coefficients& h) const
    {
        constexpr int kLeast = 9;
        constexpr float kDamping = 1e-3f, kMostTilt = 0.2f;
        constexpr float kRoughness = 0.02f; // voxels
        if (mCount < kLeast) return false;
        h = (mSquares + kDamping * Squares::Identity()).ldlt().solve(mPull);
        const float left = mSum - 2 * h.dot(mPull) + h.dot(mSquares * h);
        return left <= kRoughness * kRoughness * float(mCount) && std::abs(h[0]) <= kOffFace &&
               std::hypot(h[1], h[2]) <= kMostTilt;
    }

private:
    using Squares = Eigen::Matrix<float, 6, 6>;
    Squares mSquares = Squares::Zero();
    Coefficients mPull = Coefficients::Zero();
    float mSum = 0;
    int mCount = 0;
};

/// A patch as its face has it.
struct Fitted {
    SurfacePatch patch;
    int support = 0;       ///< other patches on its plane
    bool isSmooth = false; ///< all about it on its face lie on a quadric

    bool hasSupport() const { return support >= kLeastSupport; }
    bool isOnFace() const { return isSmooth && hasSupport(); }
};

SurfacePatch notTooBent(SurfacePatch patch)
{
    for (float& k : patch.curvature) k = std::clamp(k, -kMostBend, kMostBend);
    return patch;
}

Fitted fitted(const CreaseZone& zone, VoxelNumbers& numbers, std::uint32_t number)
{
    Fitted made;
    SurfacePatch& patch = made.patch;
    patch = zone.patches().patches[number];
    const Vec3f across = patch.normal.cross(patch.tangent);
    Heights heights;
    for (int x = -kAround; x <= kAround; ++x)
        for (int y = -kAround; y <= kAround; ++y)
            for (int z = -kAround; z <= kAround; ++z) {
                const std::uint32_t n = numbers[patch.voxel.offsetBy(x, y, z)];
                if (n == VoxelIndex::kNone || zone.patches().kinds[n] == PatchKind::Rough) continue;
                const SurfacePatch& other = zone.patches().patches[n];
                const float cosine = patch.normal.dot(other.normal);
                if (!(cosine >= kSameFace)) continue;
                const Vec3f to = -other.to(patch.voxel) - patch.foot;
                const float height = patch.normal.dot(to);
                made.support +=
                    n != number && cosine >= kSamePlane && std::abs(height) <= kOffPlane;
                if (std::abs(height) <= kOffFace)
                    heights.add(patch.tangent.dot(to), across.dot(to), height);
            }
    Heights::Coefficients h;
    if (!heights.fit(h)) {
        patch = notTooBent(patch);
        return made;
    }
    const Vec3f t = patch.tangent;
    const Eigen::Matrix3f twist = t * across.transpose();
    patch.foot += h[0] * patch.normal;
    patch.normal = (patch.normal - h[1] * t - h[2] * across).normalized();
    patch.bend(-(h[3] * t * t.transpose() + h[4] * (twist + twist.transpose()) +
                 h[5] * across * across.transpose()),
               0);
    patch = notTooBent(patch);
    made.isSmooth = true;
    return made;
}

/// In which leaves there are faces. Where there are few, details as fine as voxels pass for
/// creases, and faces would be made up.
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

    bool areFoundAbout(const Coord& voxel) const
    {
        constexpr float kLeastFaces = 0.4f; // of all that are beside creases
        const auto found = mCounts.find(originOf(voxel));
        return found != mCounts.end() &&
               float(found->second.onFaces) >= kLeastFaces * float(found->second.beside);
    }

private:
    struct Counts {
        std::size_t onFaces = 0, beside = 0;
    };
    static Coord originOf(const Coord& voxel) { return voxel & ~7; }

    /// To a leaf and those around it: a corner may have most of its faces there.
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
        if (!faces.areFoundAbout(patches.patches[numbers[n]].voxel)) continue;
        patches.patches[numbers[n]] = made[n].patch;
        if (!made[n].hasSupport()) patches.kinds[numbers[n]] = PatchKind::Rough;
    }
    for (std::size_t leaf = 0; leaf < patches.leaves.size(); ++leaf)
        if (!faces.areFoundAbout(patches.leaves[leaf]->origin()))
            zone.leaveOut(patches.first[leaf], patches.first[leaf + 1]);
}

} // namespace mpuvdb
