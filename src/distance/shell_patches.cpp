// From a shell about the surface, creases that are convex look round; of hollow ones no place is
// nearest to anything on that side. And the square of a distance is a quadratic function beside a
// plane, an edge and a corner alike: central differences of it are exact there, and lead to the
// nearest place.
#include "shell_patches.h"

#include "core/release.h"
#include "distance_front.h"
#include "grid/leaf_halo.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <tbb/blocked_range.h>
#include <tbb/combinable.h>
#include <tbb/parallel_for.h>
#include <unordered_map>

namespace mpuvdb
{
namespace
{

using Leaf = SurfacePatches::Leaf;

constexpr int kDim = LeafHalo::kDim, kHalo = LeafHalo::kHalo;
constexpr int kStride[3] = {kHalo * kHalo, kHalo, 1};
/// The shell, voxels from the surface: as far off as a band of three lets its voxels' neighbors
/// be known, and one thick, so that each way from the surface leads past its voxels.
constexpr float kNearest = 0.9f, kFarthest = 1.9f;
/// Values so near to the background, relative to it, come from beyond the band.
constexpr float kBeyond = 1e-3f;
/// By how much, voxels, the length of the way to the surface and the value may differ: near the
/// medial axis the differences tell neither.
constexpr float kMostOff = 0.3f;
/// As far as this, voxels, distances to patches are compared with values; and by how much they may
/// differ.
constexpr float kCompared = 3;
constexpr float kMostWrong = 0.02f;
/// Of the shell's voxels so many have to lead to the surface.
constexpr double kLeastShare = 0.5;
/// Half the square of a distance bends by no more than 1 anywhere [semiconcave, as the least of
/// such functions]. Values that bend more, where they are larger than the distance to an edge, say,
/// are none; no more than so many of the shell's voxels may have them.
constexpr float kMostBent = 1.1f;
constexpr double kMostShare = 1e-3;
/// What is bent more, per voxel, counts as an edge: fits' and grids' own roundings are.
constexpr float kSharpest = 1;
/// Patches' radii, voxels: where the next begins. What is nearest to places beside an edge lies on
/// it: past there, a patch tells more than is known.
constexpr float kExtent = 0.9f, kEdgeExtent = 0.2f;

/// Half the square of the distance around a voxel: gradient and second derivatives.
struct Square {
    Vec3f gradient; ///< from the nearest place to the voxel
    Eigen::Matrix3f hessian;
};

/// What a shell's voxels are.
struct Shell {
    std::uint64_t voxels = 0, known = 0, patches = 0, bent = 0;

    void add(const Shell& part)
    {
        voxels += part.voxels;
        known += part.known;
        patches += part.patches;
        bent += part.bent;
    }
    Sight sight() const
    {
        if (double(bent) > kMostShare * double(known)) return Sight::NoDistances;
        const bool leadToSurface = double(patches) >= kLeastShare * double(voxels);
        return leadToSurface && patches > 0 ? Sight::Distances : Sight::TooNarrow;
    }
};

/// Patches that one leaf's voxels are nearest to.
class ShellLeaf
{
public:
    ShellLeaf(const openvdb::FloatTree& tree, double voxelSize, float side)
        : mAccess(tree), mScale(float(1 / voxelSize)),
          mBeyond(tree.background() * mScale * (1 - kBeyond)), mSide(side)
    {
    }

    /// @param shell  gets the leaf's voxels.
    void addPatches(const Leaf& leaf, std::vector<SurfacePatch>& patches, Shell& shell)
    {
        bool loaded = false;
        for (auto value = leaf.cbeginValueOn(); value; ++value) {
            const float height = *value * mScale * mSide;
            if (!(height >= kNearest && height < kFarthest)) continue;
            if (!loaded) mHalo.load(mAccess, leaf, mScale);
            loaded = true;
            ++shell.voxels;
            const int in = inHalo(int(value.pos()));
            Square square;
            if (!squareAt(in, square)) continue;
            ++shell.known;
            shell.bent += square.hessian.diagonal().maxCoeff() > kMostBent;
            if (std::abs(square.gradient.norm() - height) < kMostOff)
                patches.push_back(patch(value.getCoord(), height, square));
        }
        shell.patches += patches.size();
    }

private:
    static int inHalo(int voxel)
    {
        return LeafHalo::index(voxel / (kDim * kDim) + 1, voxel / kDim % kDim + 1,
                               voxel % kDim + 1);
    }

    SurfacePatch patch(const openvdb::Coord& at, float height, const Square& square) const
    {
        const Vec3f away = square.gradient.normalized();
        SurfacePatch patch;
        patch.voxel = at;
        patch.foot = -height * away;
        patch.normal = mSide * away;
        patch.extent = kExtent;
        const std::array<float, 2> bend = patch.turnTangent(square.hessian);
        for (std::size_t k = 0; k < 2; ++k) {
            // Of a place of radius r that is h off it is h / (r + h).
            const float flat = std::max(1 - bend[k], 1 / kPointCurvature);
            const float curvature = bend[k] / (height * flat);
            const bool isEdge = curvature > kSharpest;
            patch.curvature[k] = mSide * (isEdge ? kPointCurvature : curvature);
            if (isEdge) patch.extent = kEdgeExtent;
        }
        return patch;
    }

    bool known(int in) const { return std::abs(mHalo.value[std::size_t(in)]) < mBeyond; }
    float squareOf(int in) const
    {
        const float v = mHalo.value[std::size_t(in)];
        return 0.5f * v * v;
    }

    /// False beside the band's rim.
    bool squareAt(int in, Square& q) const
    {
        const float here = squareOf(in);
        for (int axis = 0; axis < 3; ++axis) {
            const int s = kStride[axis];
            if (!known(in - s) || !known(in + s)) return false;
            const float low = squareOf(in - s), high = squareOf(in + s);
            q.gradient[axis] = 0.5f * (high - low);
            q.hessian(axis, axis) = (high - here) - (here - low);
        }
        for (int axis = 0; axis < 3; ++axis) {
            const int other = (axis + 1) % 3;
            q.hessian(axis, other) = q.hessian(other, axis) = mixed(in, axis, other, q);
        }
        return true;
    }

    /// The mixed second derivative, from those of the four corners that are known.
    float mixed(int in, int a, int b, const Square& q) const
    {
        const float here = squareOf(in), bent = 0.5f * (q.hessian(a, a) + q.hessian(b, b));
        float sum = 0;
        int count = 0;
        for (const int s : {-1, 1}) {
            for (const int t : {-1, 1}) {
                const int corner = in + s * kStride[a] + t * kStride[b];
                if (!known(corner)) continue;
                const float straight =
                    here + float(s) * q.gradient[a] + float(t) * q.gradient[b] + bent;
                sum += float(s * t) * (squareOf(corner) - straight);
                ++count;
            }
        }
        return count > 0 ? sum / float(count) : 0;
    }

    LeafHalo::Accessor mAccess;
    LeafHalo mHalo;
    float mScale, mBeyond, mSide;
};

/// Let the shell's voxels of each of @a leaves have patches: f(number, patches).
template <typename F>
Shell forEachShellLeaf(const openvdb::FloatTree& tree, const std::vector<const Leaf*>& leaves,
                       double voxelSize, float side, Interrupter& progress, F f)
{
    tbb::combinable<Shell> shells;
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, leaves.size(), 16),
                      [&](const tbb::blocked_range<std::size_t>& range) {
                          progress.check();
                          ShellLeaf shell(tree, voxelSize, side);
                          for (std::size_t n = range.begin(); n < range.end(); ++n) {
                              std::vector<SurfacePatch> patches;
                              shell.addPatches(*leaves[n], patches, shells.local());
                              f(n, std::move(patches));
                          }
                      });
    Shell sum;
    shells.combine_each([&](const Shell& part) { sum.add(part); });
    return sum;
}

/// The patches that the voxels of the shell are nearest to, about one for each voxel that the
/// surface passes; none at all unless @a sight becomes that of distances.
SurfacePatches shellPatches(const openvdb::FloatTree& tree, double voxelSize, float side,
                            Sight& sight, Interrupter& progress)
{
    SurfacePatches result;
    tree.getNodes(result.leaves);
    const std::size_t leaves = result.leaves.size();
    result.first.assign(leaves + 1, 0);
    std::vector<std::vector<SurfacePatch>> found(leaves);
    const Shell shell = forEachShellLeaf(
        tree, result.leaves, voxelSize, side, progress,
        [&](std::size_t n, std::vector<SurfacePatch>&& patches) { found[n] = std::move(patches); });
    requireIndexable(shell.patches);
    sight = shell.sight();
    if (sight != Sight::Distances) return result;
    result.patches.reserve(shell.patches);
    for (std::size_t n = 0; n < leaves; ++n) {
        result.patches.insert(result.patches.end(), found[n].begin(), found[n].end());
        result.first[n + 1] = std::uint32_t(result.patches.size());
        release(found[n]);
    }
    return result;
}

/// Compares distances to patches with the values of a tree.
class Comparison
{
public:
    Comparison(const SurfacePatches& patches, const SurfacePatches& shell, double voxelSize,
               float side)
        : mShell(shell), mScale(float(1 / voxelSize)), mSide(side), mWrong(patches.patches.size()),
          mTeller(shell.patches.size(), kNoPatch)
    {
        for (std::size_t n = 0; n < shell.leaves.size(); ++n) mLeaves.emplace(shell.leaves[n], n);
    }

    /// May be called from many threads, once for each leaf.
    void add(const Leaf& leaf, const LeafDistances& found)
    {
        std::uint32_t next = mShell.first[mLeaves.at(&leaf)];
        for (auto value = leaf.cbeginValueOn(); value; ++value) {
            const float height = *value * mScale * mSide;
            if (!(height >= kNearest && height < kCompared)) continue;
            const int voxel = int(value.pos());
            const std::uint32_t patch = found.patch(voxel);
            if (patch != kNoPatch && std::abs(found.at(voxel) * mSide - height) > kMostWrong)
                mWrong[patch].store(true, std::memory_order_relaxed);
            if (next < mTeller.size() && mShell.patches[next].voxel == value.getCoord())
                mTeller[next++] = patch;
        }
    }

    bool isWrong(std::uint32_t patch) const { return mWrong[patch]; }
    /// Whether the place nearest to the voxel of the shell's patch is told wrongly, or not at all.
    bool isMissing(std::uint32_t patch) const
    {
        return mTeller[patch] == kNoPatch || isWrong(mTeller[patch]);
    }

private:
    const SurfacePatches& mShell;
    float mScale, mSide;
    std::unordered_map<const Leaf*, std::size_t> mLeaves;
    std::vector<std::atomic<bool>> mWrong; ///< by patch
    std::vector<std::uint32_t> mTeller;    ///< by the shell's patch: what its voxel is nearest to
};

} // namespace

Sight sightFrom(const openvdb::FloatTree& tree, double voxelSize, float side, Interrupter& progress)
{
    std::vector<const Leaf*> leaves;
    tree.getNodes(leaves);
    return forEachShellLeaf(tree, leaves, voxelSize, side, progress,
                            [](std::size_t, const std::vector<SurfacePatch>&) {})
        .sight();
}

Sight refineByShellProjection(SurfacePatches& patches, const openvdb::FloatTree& tree,
                              double voxelSize, float side, Interrupter& progress)
{
    Sight sight = Sight::TooNarrow;
    const SurfacePatches shell = shellPatches(tree, voxelSize, side, sight, progress);
    if (sight != Sight::Distances) return sight;
    Comparison comparison(patches, shell, voxelSize, side);
    spreadDistances(
        tree, patches, side > 0 ? Reach{kCompared, 0} : Reach{0, kCompared},
        [&](const openvdb::Coord&, const Leaf* leaf, const LeafDistances& found) {
            if (leaf) comparison.add(*leaf, found);
            return FinishedLeaf{};
        },
        progress, 0);
    const auto own = std::uint32_t(patches.patches.size());
    patches.superseded.resize(own, false);
    for (std::uint32_t n = 0; n < own; ++n)
        if (comparison.isWrong(n)) patches.superseded[n] = true;
    for (std::uint32_t n = 0; n < shell.patches.size(); ++n)
        if (comparison.isMissing(n)) patches.patches.push_back(shell.patches[n]);
    requireIndexable(patches.patches.size());
    return sight;
}

} // namespace mpuvdb
