// The squared distance is a quadratic function beside a plane, an edge and a corner alike: central
// differences of it are exact there, and project a shell's voxels to their nearest places. Seen
// from the shell convex creases are round, and concave ones are nearest to nothing.
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

constexpr const auto& kStride = LeafHalo::kStride;
/// Distances of the shell from the surface, voxels. [derived: the neighbors of its voxels lie in a
/// band of three, and it is one thick]
constexpr float kShellFrom = 0.9f, kShellTo = 1.9f;
/// Largest difference between the length of a projection and the value, voxels: it is large near
/// the medial axis. [tuned: offset_bench]
constexpr float kMaxLengthError = 0.3f;
/// Distance from the surface up to which patches are compared with values, voxels, and the largest
/// difference. [tuned: offset_bench]
constexpr float kComparedWidth = 3;
constexpr float kMaxError = 0.02f;
/// Smallest share of the shell's voxels with a projection. [tuned: offset_bench]
constexpr double kMinProjected = 0.5;
/// Largest second derivative of half the squared distance, which is semiconcave with bound 1, and
/// largest share of the shell's voxels beyond it. [tuned: offset_bench]
constexpr float kMaxBend = 1.1f;
constexpr double kMaxBentShare = 1e-3;
/// Largest curvature, per voxel; beyond it a patch is that of an edge. [tuned: offset_bench]
constexpr float kMaxCurvature = 1;

/// Half the squared distance around a voxel: gradient and second derivatives.
struct Square {
    Vec3f gradient; ///< from the nearest place to the voxel
    Eigen::Matrix3f hessian;
};

/// Counts of a shell's voxels.
struct Shell {
    std::uint64_t voxels = 0, known = 0, patches = 0, bent = 0;

    void add(const Shell& part)
    {
        voxels += part.voxels;
        known += part.known;
        patches += part.patches;
        bent += part.bent;
    }
    ShellValues values() const
    {
        if (double(bent) > kMaxBentShare * double(known)) return ShellValues::NoDistances;
        const bool leadToSurface = double(patches) >= kMinProjected * double(voxels);
        return leadToSurface && patches > 0 ? ShellValues::Distances : ShellValues::TooNarrow;
    }
};

/// Makes the patches that one leaf's voxels are nearest to.
class ShellLeaf
{
public:
    ShellLeaf(const openvdb::FloatTree& tree, double voxelSize, float side)
        : mAccess(tree), mScale(float(1 / voxelSize)),
          mBeyond(tree.background() * mScale * (1 - kRimTolerance)), mSide(side)
    {
    }

    /// @param shell  the leaf's voxels are added to its counts.
    void addPatches(const Leaf& leaf, std::vector<SurfacePatch>& patches, Shell& shell)
    {
        bool loaded = false;
        for (auto value = leaf.cbeginValueOn(); value; ++value) {
            const float height = *value * mScale * mSide;
            if (!(height >= kShellFrom && height < kShellTo)) continue;
            if (!loaded) mHalo.load(mAccess, leaf.origin(), mScale);
            loaded = true;
            ++shell.voxels;
            const int in = inHalo(int(value.pos()));
            Square square;
            if (!squareAt(in, square)) continue;
            ++shell.known;
            shell.bent += square.hessian.diagonal().maxCoeff() > kMaxBend;
            if (std::abs(square.gradient.norm() - height) < kMaxLengthError)
                patches.push_back(patch(value.getCoord(), height, square));
        }
        shell.patches += patches.size();
    }

private:
    static int inHalo(int voxel)
    {
        return LeafHalo::index(voxel / (kBlockDim * kBlockDim), voxel / kBlockDim % kBlockDim,
                               voxel % kBlockDim);
    }

    SurfacePatch patch(const openvdb::Coord& at, float height, const Square& square) const
    {
        const Vec3f away = square.gradient.normalized();
        SurfacePatch patch;
        patch.voxel = at;
        patch.foot = -height * away;
        patch.normal = mSide * away;
        patch.extent = kPatchRadius;
        const std::array<float, 2> bend = patch.turnTangent(square.hessian);
        for (std::size_t k = 0; k < 2; ++k) {
            // At height h over a place of radius r the second derivative is h / (r + h).
            const float flat = std::max(1 - bend[k], 1 / kPointCurvature);
            const float curvature = bend[k] / (height * flat);
            const bool isEdge = curvature > kMaxCurvature;
            patch.curvature[k] = mSide * (isEdge ? kPointCurvature : curvature);
            if (isEdge) patch.extent = kCreasePatchRadius;
        }
        return patch;
    }

    bool known(int in) const { return std::abs(mHalo.value[std::size_t(in)]) < mBeyond; }
    float squareOf(int in) const
    {
        const float v = mHalo.value[std::size_t(in)];
        return 0.5f * v * v;
    }

    /// Compute half the squared distance; false beside the band's rim.
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

    /// The mixed second derivative, from the known ones of the four corners.
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

    openvdb::tree::ValueAccessor<const openvdb::FloatTree> mAccess;
    LeafHalo mHalo;
    float mScale, mBeyond, mSide;
};

/// Call f(number, patches) with the patches of the shell's voxels for each of @a leaves.
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

/// The patches that the voxels of the shell are nearest to, about one for each voxel at the
/// surface; none unless @a values becomes ShellValues::Distances.
SurfacePatches shellPatches(const openvdb::FloatTree& tree, double voxelSize, float side,
                            ShellValues& values, Interrupter& progress)
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
    values = shell.values();
    if (values != ShellValues::Distances) return result;
    result.patches.reserve(shell.patches);
    for (std::size_t n = 0; n < leaves; ++n) {
        result.patches.insert(result.patches.end(), found[n].begin(), found[n].end());
        result.first[n + 1] = std::uint32_t(result.patches.size());
        release(found[n]);
    }
    return result;
}

/// Compares the distances to patches with the values of a tree.
class Comparison
{
public:
    Comparison(const SurfacePatches& patches, const SurfacePatches& shell, double voxelSize,
               float side)
        : mShell(shell), mScale(float(1 / voxelSize)), mSide(side), mWrong(patches.patches.size()),
          mClosest(shell.patches.size(), kNoPatch)
    {
        for (std::size_t n = 0; n < shell.leaves.size(); ++n) mLeaves.emplace(shell.leaves[n], n);
    }

    /// May be called from many threads, once for each leaf.
    void add(const Leaf& leaf, const LeafDistances& found)
    {
        std::uint32_t next = mShell.first[mLeaves.at(&leaf)];
        for (auto value = leaf.cbeginValueOn(); value; ++value) {
            const float height = *value * mScale * mSide;
            if (!(height >= kShellFrom && height < kComparedWidth)) continue;
            const int voxel = int(value.pos());
            const std::uint32_t patch = found.patch(voxel);
            if (patch != kNoPatch && std::abs(found.at(voxel) * mSide - height) > kMaxError)
                mWrong[patch].store(true, std::memory_order_relaxed);
            if (next < mClosest.size() && mShell.patches[next].voxel == value.getCoord())
                mClosest[next++] = patch;
        }
    }

    bool isWrong(std::uint32_t patch) const { return mWrong[patch]; }
    /// Whether the voxel of the shell's patch has no closest patch, or a wrong one.
    bool isMissing(std::uint32_t patch) const
    {
        return mClosest[patch] == kNoPatch || isWrong(mClosest[patch]);
    }

private:
    const SurfacePatches& mShell;
    float mScale, mSide;
    std::unordered_map<const Leaf*, std::size_t> mLeaves;
    std::vector<std::atomic<bool>> mWrong; ///< by patch
    std::vector<std::uint32_t> mClosest;   ///< by the shell's patch: closest patch of its voxel
};

} // namespace

ShellValues shellValues(const openvdb::FloatTree& tree, double voxelSize, float side,
                        Interrupter& progress)
{
    std::vector<const Leaf*> leaves;
    tree.getNodes(leaves);
    return forEachShellLeaf(tree, leaves, voxelSize, side, progress,
                            [](std::size_t, const std::vector<SurfacePatch>&) {})
        .values();
}

ShellValues refineByShellProjection(SurfacePatches& patches, const openvdb::FloatTree& tree,
                                    double voxelSize, float side, Interrupter& progress)
{
    ShellValues values = ShellValues::TooNarrow;
    const SurfacePatches shell = shellPatches(tree, voxelSize, side, values, progress);
    if (values != ShellValues::Distances) return values;
    Comparison comparison(patches, shell, voxelSize, side);
    spreadDistances(
        tree, patches, side > 0 ? Reach{kComparedWidth, 0} : Reach{0, kComparedWidth},
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
    return values;
}

} // namespace mpuvdb
