#include "surface_patches.h"

#include "crease_facets.h"
#include "grid/leaf_halo.h"
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <limits>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

using Leaf = SurfacePatches::Leaf;

constexpr const auto& kStride = LeafHalo::kStride;
/// Smallest slope of a distance with a meaningful direction. [tuned: redistance_test]
constexpr float kMinSlope = 0.3f;
/// Smallest slope of values that are not distances, per voxel. [tuned: redistance_test]
constexpr float kMinImplicitSlope = 1e-6f;
/// Change of the gradient from voxel to voxel, relative to the slope, beyond which there may be a
/// crease. [tuned: offset_bench]
constexpr float kCreaseChange = 0.22f;
/// Largest error of one octant's plane beside a crease, relative to that change. [tuned:
/// offset_bench]
constexpr float kPlaneChange = 0.25f;
/// Largest error of such a plane relative to the slope, and largest difference of a distance's
/// slope from 1; and the error of values that are not distances, which may bend more. [tuned:
/// offset_bench]
constexpr float kPlaneError = 0.03f, kImplicitPlaneError = 0.06f;
/// Largest distance of the interpolated zero set from a foot on the model's, voxels.
/// [tuned: redistance_test]
constexpr float kMaxFootError = 0.2f;
/// Largest distance of a foot beyond the nearest crossing, voxels: linear crossings err by the bend
/// of the values between two voxels. [tuned: redistance_test]
constexpr float kMaxPastCrossing = 0.1f;

/// The values around one voxel as a quadratic function.
struct Quadratic {
    float value;
    Vec3f gradient;
    Eigen::Matrix3f hessian;

    float at(const Vec3f& d) const { return value + gradient.dot(d) + 0.5f * d.dot(hessian * d); }
    Vec3f gradientAt(const Vec3f& d) const { return gradient + hessian * d; }
};

/// Makes the patches of a leaf's voxels.
class PatchMaker
{
public:
    PatchMaker(const openvdb::FloatTree& tree, double voxelSize, Values values)
        : mAccess(tree), mScale(float(1 / voxelSize)),
          mBeyond(tree.background() * mScale * (1 - kRimTolerance)), mValues(values),
          mMaxPlaneError(values == Values::Distances ? kPlaneError : kImplicitPlaneError)
    {
    }

    /// Call f(offset in the leaf) for all active voxels with a face neighbor of the other sign, or
    /// of value 0.
    template <typename F>
    void forEachCrossing(const Leaf& leaf, F f)
    {
        mHalo.load(mAccess, leaf.origin(), mScale);
        for (int row = 0; row < kBlockDim * kBlockDim; ++row) {
            unsigned active = leaf.getValueMask().getWord<std::uint8_t>(openvdb::Index(row));
            if (active == 0) continue;
            const int in = LeafHalo::index(row / kBlockDim, row % kBlockDim, 0);
            const unsigned own = signs(in);
            unsigned crosses = 0;
            for (const int stride : kStride)
                crosses |= (own ^ signs(in - stride)) | (own ^ signs(in + stride));
            crosses |= zeros(in);
            for (unsigned bits = crosses & active; bits; bits &= bits - 1)
                f(row * kBlockDim + __builtin_ctz(bits));
        }
    }

    /// The patch of a voxel of the leaf that forEachCrossing() visits. @param besideCrease  whether
    /// a neighbor's patch is not smooth.
    SurfacePatch make(const Leaf& leaf, int voxel, bool besideCrease, PatchKind& kind) const
    {
        const int x = voxel / (kBlockDim * kBlockDim), y = voxel / kBlockDim % kBlockDim,
                  z = voxel % kBlockDim;
        const int in = LeafHalo::index(x, y, z);
        SurfacePatch patch;
        patch.voxel = leaf.origin() + openvdb::Coord(x, y, z);
        patch.extent = kPatchRadius;
        Quadratic model = modelAt(in);
        kind = PatchKind::Smooth;
        const float slope = model.gradient.norm(), change = model.hessian.cwiseAbs().maxCoeff();
        const bool isBent = model.hessian.diagonal().cwiseAbs().maxCoeff() > kCreaseChange * slope;
        if (besideCrease || change > kCreaseChange * slope) {
            if (flatten(in, besideCrease ? slope : kPlaneChange * change, model))
                kind = PatchKind::Plane;
            else if (isBent)
                kind = PatchKind::Rough;
        }
        const bool found =
            mValues == Values::Distances ? touch(model, patch) : intersect(model, in, patch);
        SurfacePatch crossing = nearestCrossing(patch.voxel, in);
        // A foot farther away than a crossing is not the nearest place.
        if (found && patch.foot.norm() <= crossing.foot.norm() + kMaxPastCrossing) return patch;
        kind = PatchKind::Rough;
        return crossing;
    }

private:
    /// Signs of eight voxels in a row.
    unsigned signs(int in) const
    {
        unsigned bits = 0;
        for (int z = 0; z < kBlockDim; ++z) bits |= unsigned(mHalo.value[in + z] < 0) << z;
        return bits;
    }

    /// Which of eight voxels in a row lie on the surface: value 0 between inside and outside.
    unsigned zeros(int in) const
    {
        unsigned bits = 0;
        for (int z = 0; z < kBlockDim; ++z)
            if (mHalo.value[in + z] == 0) bits |= unsigned(isBetween(in + z)) << z;
        return bits;
    }

    bool isBetween(int in) const
    {
        bool inside = false, outside = false;
        for (int n = 0; n < 27; ++n) {
            const float v = mHalo.value[in + (n / 9 - 1) * kStride[0] +
                                        (n / 3 % 3 - 1) * kStride[1] + (n % 3 - 1) * kStride[2]];
            inside |= v < 0;
            outside |= v > 0;
        }
        return inside && outside;
    }

    bool known(int in) const { return std::abs(mHalo.value[in]) < mBeyond; }

    /// The model by central differences; one-sided beside the band's rim.
    Quadratic modelAt(int in) const
    {
        const auto& v = mHalo.value;
        Quadratic q;
        q.value = v[in];
        q.hessian.setZero();
        for (int axis = 0; axis < 3; ++axis) {
            const int s = kStride[axis];
            const bool low = known(in - s), high = known(in + s);
            const float rise = low ? v[in] - v[in - s] : 0, next = high ? v[in + s] - v[in] : 0;
            q.gradient[axis] = low && high ? 0.5f * (rise + next) : rise + next;
            if (low && high) q.hessian(axis, axis) = next - rise;
            const int t = kStride[(axis + 1) % 3];
            if (known(in + s + t) && known(in + s - t) && known(in - s + t) && known(in - s - t))
                q.hessian(axis, (axis + 1) % 3) = q.hessian((axis + 1) % 3, axis) =
                    0.25f * ((v[in + s + t] - v[in + s - t]) - (v[in - s + t] - v[in - s - t]));
        }
        return q;
    }

    /// Replace the model by a plane if the values in one octant are linear. @param most  largest
    /// error.
    bool flatten(int in, float most, Quadratic& model) const
    {
        struct Fit {
            Vec3f gradient;
            float off = std::numeric_limits<float>::infinity(), slope = 0;
        };
        std::array<Fit, 8> fits;
        float steepest = 0;
        for (int octant = 0; octant < 8; ++octant) {
            Fit fit;
            if (!planeOf(in, octant, fit.gradient, fit.off)) continue;
            fit.slope = fit.gradient.norm();
            const bool isSlope =
                mValues == Values::Implicit || std::abs(fit.slope - 1) < kPlaneError;
            if (!isSlope || !(fit.off < most) || !(fit.off < mMaxPlaneError * fit.slope)) continue;
            fits[std::size_t(octant)] = fit;
            steepest = std::max(steepest, fit.slope);
        }
        // An octant across a crease may look like a plane less steep than those of both sides.
        const Fit* best = nullptr;
        for (const Fit& fit : fits)
            if (fit.slope > (1 - kPlaneError) * steepest && (!best || fit.off < best->off))
                best = &fit;
        if (!best) return false;
        model.gradient = best->gradient;
        model.hessian.setZero();
        return true;
    }

    /// The gradient along an octant's axes, and the largest error @a off of its plane at the other
    /// corners; false beside the band's rim.
    bool planeOf(int in, int octant, Vec3f& gradient, float& off) const
    {
        const auto& v = mHalo.value;
        int s[3];
        Vec3f rise;
        for (int axis = 0; axis < 3; ++axis) {
            const bool up = octant >> axis & 1;
            s[axis] = up ? kStride[axis] : -kStride[axis];
            if (!known(in + s[axis])) return false;
            rise[axis] = v[in + s[axis]] - v[in];
            gradient[axis] = up ? rise[axis] : -rise[axis];
        }
        off = 0;
        for (int n = 0; n < 4; ++n) { // two axes of three, and all
            const Vec3f on(n != 0, n != 1, n != 2);
            const int at = in + (n != 0) * s[0] + (n != 1) * s[1] + (n != 2) * s[2];
            if (!known(at)) return false;
            off = std::max(off, std::abs(v[at] - v[in] - on.dot(rise)));
        }
        return true;
    }

    /// The place where the ball of the voxel's distance touches the surface.
    static bool touch(const Quadratic& model, SurfacePatch& patch)
    {
        const float slope = model.gradient.norm();
        if (!(slope >= kMinSlope)) return false;
        patch.normal = model.gradient / slope;
        patch.foot = -model.value * patch.normal;
        patch.bend(model.hessian / slope, model.value);
        return true;
    }

    /// The zero of the model along its gradient, if the interpolated values are zero there too.
    bool intersect(const Quadratic& model, int in, SurfacePatch& patch) const
    {
        constexpr int kNewtonSteps = 4; ///< number of steps [tuned: redistance_test]
        Vec3f d = Vec3f::Zero(), g = model.gradient;
        for (int step = 0; step < kNewtonSteps; ++step) {
            const float g2 = g.squaredNorm();
            if (!(g2 > kMinImplicitSlope * kMinImplicitSlope)) return false;
            d -= model.at(d) / g2 * g;
            if (!(d.cwiseAbs().maxCoeff() <= 1)) return false;
            g = model.gradientAt(d);
        }
        const float slope = g.norm();
        if (!(std::abs(interpolated(in, d)) <= kMaxFootError * slope)) return false;
        patch.normal = g / slope;
        patch.foot = d;
        patch.bend(model.hessian / slope, -d.dot(patch.normal));
        return true;
    }

    /// The value at @a d, each of its components in [-1,1], from the voxel.
    float interpolated(int in, const Vec3f& d) const
    {
        float weight[3][2];
        for (int axis = 0; axis < 3; ++axis) {
            const bool below = d[axis] < 0;
            if (below) in -= kStride[axis];
            weight[axis][1] = d[axis] + float(below);
            weight[axis][0] = 1 - weight[axis][1];
        }
        float sum = 0;
        for (int n = 0; n < 8; ++n) {
            const int corner =
                in + (n >> 2) * kStride[0] + (n >> 1 & 1) * kStride[1] + (n & 1) * kStride[2];
            sum +=
                weight[0][n >> 2] * weight[1][n >> 1 & 1] * weight[2][n & 1] * mHalo.value[corner];
        }
        return sum;
    }

    /// The nearest zero crossing of the values, linear between voxels: the patch of last resort.
    SurfacePatch nearestCrossing(const openvdb::Coord& voxel, int in) const
    {
        const auto& v = mHalo.value;
        // The voxel itself, unless a neighbor has the other sign.
        SurfacePatch patch = SurfacePatch::point(voxel, Vec3f::Zero());
        float best = std::numeric_limits<float>::infinity();
        for (int axis = 0; axis < 3; ++axis) {
            for (const int side : {-1, 1}) {
                const float other = v[in + side * kStride[axis]];
                if ((other < 0) == (v[in] < 0)) continue;
                const float at = v[in] / (v[in] - other);
                if (!(at < best)) continue;
                best = at;
                patch.foot = float(side) * at * Vec3f::Unit(axis);
                patch.normal = (v[in] < 0 ? 1.0f : -1.0f) * float(side) * Vec3f::Unit(axis);
            }
        }
        patch.tangent = patch.normal.unitOrthogonal();
        return patch;
    }

    openvdb::tree::ValueAccessor<const openvdb::FloatTree> mAccess;
    LeafHalo mHalo;
    float mScale, mBeyond;
    Values mValues;
    float mMaxPlaneError; ///< of an octant's values, relative to the slope
};

} // namespace

SurfacePatches surfacePatches(const openvdb::FloatTree& tree, double voxelSize, Values values,
                              Interrupter& progress)
{
    std::vector<const Leaf*> leaves;
    tree.getNodes(leaves);
    return surfacePatches(tree, std::move(leaves), voxelSize, values, progress);
}

SurfacePatches surfacePatches(const openvdb::FloatTree& tree, std::vector<const Leaf*> leaves,
                              double voxelSize, Values values, Interrupter& progress)
{
    SurfacePatches result;
    result.leaves = std::move(leaves);
    result.first.assign(result.leaves.size() + 1, 0);
    const auto forEachLeaf = [&](auto f) {
        tbb::parallel_for(tbb::blocked_range<std::size_t>(0, result.leaves.size(), 16),
                          [&](const tbb::blocked_range<std::size_t>& range) {
                              progress.check();
                              PatchMaker maker(tree, voxelSize, values);
                              for (std::size_t n = range.begin(); n < range.end(); ++n) f(maker, n);
                          });
    };
    forEachLeaf([&](PatchMaker& maker, std::size_t n) {
        std::uint32_t count = 0;
        maker.forEachCrossing(*result.leaves[n], [&](int) { ++count; });
        result.first[n + 1] = count;
    });
    std::uint64_t sum = 0;
    for (std::uint32_t& count : result.first) {
        sum += count;
        count = std::uint32_t(sum);
    }
    requireIndexable(sum);
    result.patches.resize(sum);
    result.kinds.resize(sum);
    forEachLeaf([&](PatchMaker& maker, std::size_t n) {
        std::uint32_t to = result.first[n];
        const Leaf& leaf = *result.leaves[n];
        maker.forEachCrossing(leaf, [&](int voxel) {
            result.patches[to] = maker.make(leaf, voxel, false, result.kinds[to]);
            ++to;
        });
    });
    if (std::all_of(result.kinds.begin(), result.kinds.end(),
                    [](PatchKind kind) { return kind == PatchKind::Smooth; }))
        return result;
    CreaseZone zone(result, tree, float(1 / voxelSize), values, progress);
    forEachLeaf([&](PatchMaker& maker, std::size_t n) {
        std::uint32_t to = result.first[n];
        if (zone.countBeside(to, result.first[n + 1]) == 0) return;
        const Leaf& leaf = *result.leaves[n];
        maker.forEachCrossing(leaf, [&](int voxel) {
            if (zone.isBeside(to))
                result.patches[to] = maker.make(leaf, voxel, true, result.kinds[to]);
            ++to;
        });
    });
    addCreaseFacets(result, zone, progress);
    for (std::uint32_t n = 0; n < result.voxelPatches(); ++n)
        if (result.kinds[n] == PatchKind::Plane && !zone.isBeside(n))
            result.patches[n].extent = kCreasePatchRadius;
    return result;
}

} // namespace mpuvdb
