#include "crease_patches.h"

#include "patch_index.h"

#include <mpuvdb/progress.h>

#include <algorithm>
#include <optional>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using Leaf = SurfacePatches::Leaf;

constexpr int kAround = 2; ///< voxels about one whose patches are looked at
/// Places of one face: the cosine of their normals, and the height of one over the other's plane.
constexpr float kSameFace = 0.9f, kOffFace = 0.5f;
constexpr float kMostBend = 0.3f;     ///< of patches and of their ends, per voxel
constexpr float kLeastSine = 0.2f;    ///< of two faces that meet in a crease
constexpr float kSameSide = 0.95f;    ///< cosine of ends that look the same way
constexpr float kFarthest = 2.2f;     ///< of a crease from a foot, voxels
constexpr float kBeyond = 0.8f;       ///< of a foot beyond a crease
constexpr float kLeastHeight = 0.02f; ///< of one foot above the other's plane, to tell the side
constexpr float kOffSurface = 0.35f;  ///< of a crease from the surface that the values tell
constexpr float kOffReach = 0.55f;    ///< of places of a patch from that surface
/// How far from its foot a patch may go, voxels: the farthest that the values allow.
constexpr float kReaches[] = {1.6f, 1.2f, 0.8f, 0.4f};
/// Only flat ones go all the way: others bend otherwise than their feet tell. Those without ends
/// lie beside what is no crease, such as a narrow fillet. And what a part of another has at least.
constexpr float kBentReach = 0.8f, kEndlessReach = 0.4f, kPartReach = 0.4f;
constexpr float kFlat = 0.02f; ///< flat ones bend less, per voxel
constexpr int kSteps = 2;      ///< to where two bent patches meet
/// Of a crossing from the patch that it belongs to; and what a voxel of distance from that patch's
/// foot counts beside it.
constexpr float kOffPatch = 0.4f, kAside = 0.1f;

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
        constexpr float kRoughness = 0.05f; ///< voxels
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

/// What becomes of a patch.
struct Ended {
    SurfacePatch patch;
    PatchEnds ends;
};

/// For one thread.
class CreaseFinder
{
public:
    CreaseFinder(const SurfacePatches& patches, const PatchIndex& index,
                 const openvdb::FloatTree& tree)
        : mPatches(patches), mNear(index), mAccess(tree)
    {
    }

    /// A patch that is a plane by the values of one octant, or whose gradient may be from both
    /// sides of a crease, as the feet of the same face around say that it lies and bends.
    SurfacePatch bent(std::uint32_t number)
    {
        SurfacePatch patch = mPatches.patches[number];
        const Vec3f across = patch.normal.cross(patch.tangent);
        Heights heights;
        mNear.forEach(patch.voxel, kAround, [&](std::uint32_t n) {
            const SurfacePatch& other = mPatches.patches[n];
            if (mPatches.kinds[n] == PatchKind::Rough ||
                !(patch.normal.dot(other.normal) >= kSameFace))
                return;
            const Vec3f to = -other.to(patch.voxel) - patch.foot;
            const float height = patch.normal.dot(to);
            if (std::abs(height) <= kOffFace)
                heights.add(patch.tangent.dot(to), across.dot(to), height);
        });
        Heights::Coefficients h;
        if (!heights.fit(h)) return notTooBent(patch);
        const Vec3f t = patch.tangent;
        const Eigen::Matrix3f twist = t * across.transpose();
        patch.foot += h[0] * patch.normal;
        patch.normal = (patch.normal - h[1] * t - h[2] * across).normalized();
        patch.bend(-(h[3] * t * t.transpose() + h[4] * (twist + twist.transpose()) +
                     h[5] * across * across.transpose()),
                   0);
        return notTooBent(patch);
    }

    /// A patch with the ends where it meets the faces around.
    Ended ended(std::uint32_t number)
    {
        Ended made{mPatches.patches[number], {}};
        collect(made.patch);
        for (const Face& face : mFaces)
            if (made.ends.count < PatchEnds::kMost) addEnd(made, face);
        made.ends.reach = reachOf(made);
        return made;
    }

    /// A rough patch as a part of one with ends, if it lies on one.
    Ended part(std::uint32_t number)
    {
        const SurfacePatch& rough = mPatches.patches[number];
        Ended result{rough, {}};
        float least = std::numeric_limits<float>::infinity();
        mNear.forEach(rough.voxel, kAround, [&](std::uint32_t n) {
            const SurfacePatch& p = mPatches.patches[n];
            if (mPatches.kinds[n] == PatchKind::Rough || p.ends == SurfacePatch::kEndless) return;
            const PatchEnds& ends = mPatches.ends[p.ends];
            const Vec3f from = p.to(rough.voxel);
            const float off = p.distance(from + rough.foot, 1, &ends);
            if (!(off <= kOffPatch)) return;
            const Vec2f at =
                ends.nearest({p.tangent.dot(from), p.normal.cross(p.tangent).dot(from)});
            const float score = off + kAside * at.norm();
            if (!(at.norm() <= kFarthest) || !(score < least)) return;
            least = score;
            result = seenFrom(p, ends, at);
            result.ends.reach = std::max(ends.reach - at.norm(), kPartReach);
            result.patch.foot = -result.patch.to(rough.voxel);
            result.patch.voxel = rough.voxel;
        });
        return result;
    }

private:
    /// A neighbour's patch, relative to the voxel.
    struct Face {
        const SurfacePatch* patch;
        Vec3f point, normal;
        float distance2; ///< between the feet

        /// Of a place above the patch, which bends.
        float heightOf(const Vec3f& place) const
        {
            const Vec3f to = place - point;
            const float u = patch->tangent.dot(to), v = normal.cross(patch->tangent).dot(to);
            return normal.dot(to) +
                   0.5f * (patch->curvature[0] * u * u + patch->curvature[1] * v * v);
        }
    };

    /// The normal of a patch, which bends, at a place beside it.
    static Vec3f normalAt(const SurfacePatch& p, const Vec3f& place)
    {
        const Vec3f across = p.normal.cross(p.tangent), to = place - p.foot;
        return (p.normal + p.curvature[0] * p.tangent.dot(to) * p.tangent +
                p.curvature[1] * across.dot(to) * across)
            .normalized();
    }

    static SurfacePatch notTooBent(SurfacePatch patch)
    {
        for (float& k : patch.curvature) k = std::min(std::max(k, -kMostBend), kMostBend);
        return patch;
    }

    static float curvatureAlong(const SurfacePatch& p, const Vec3f& direction)
    {
        const float u = p.tangent.dot(direction), v = p.normal.cross(p.tangent).dot(direction);
        return p.curvature[0] * u * u + p.curvature[1] * v * v;
    }

    /// A patch with its foot at another of its places.
    static Ended seenFrom(const SurfacePatch& p, const PatchEnds& ends, const Vec2f& at)
    {
        Ended made{p, ends.from(at)};
        const Vec3f beside = at[0] * p.tangent + at[1] * p.normal.cross(p.tangent);
        made.patch.normal = normalAt(p, p.foot + beside);
        made.patch.foot +=
            beside -
            0.5f * (p.curvature[0] * at[0] * at[0] + p.curvature[1] * at[1] * at[1]) * p.normal;
        made.patch.tangent =
            (p.tangent - p.tangent.dot(made.patch.normal) * made.patch.normal).normalized();
        return made;
    }

    /// How far a patch bends away from its plane, @a at from its foot.
    static float sag(const SurfacePatch& p, float at, const Vec3f& outward)
    {
        const float u = at * outward.dot(p.tangent);
        return 0.5f * (p.curvature[0] * u * u + p.curvature[1] * (at * at - u * u));
    }

    /// The faces around that may meet that of a patch, the nearest first.
    void collect(const SurfacePatch& patch)
    {
        mFaces.clear();
        mNear.forEach(patch.voxel, kAround, [&](std::uint32_t n) {
            if (mPatches.kinds[n] == PatchKind::Rough) return;
            const SurfacePatch& other = mPatches.patches[n];
            const Vec3f point = -other.to(patch.voxel);
            // No further part of a face that bends.
            const bool same = patch.normal.dot(other.normal) >= kSameFace;
            const Vec3f normal = same ? normalAt(patch, point) : patch.normal;
            if (!(normal.cross(other.normal).norm() >= kLeastSine)) return;
            mFaces.push_back({&other, point, other.normal, (point - patch.foot).squaredNorm()});
        });
        std::stable_sort(mFaces.begin(), mFaces.end(),
                         [](const Face& a, const Face& b) { return a.distance2 < b.distance2; });
    }

    /// How far a patch goes on in all directions, by the values.
    float reachOf(Ended made) const
    {
        constexpr int kDirections = 8;
        const auto& k = made.patch.curvature;
        const bool isFlat = std::max(std::abs(k[0]), std::abs(k[1])) <= kFlat;
        const float most = made.ends.count == 0 ? kEndlessReach : isFlat ? kReaches[0] : kBentReach;
        for (const float reach : kReaches) {
            if (reach > most) continue;
            made.ends.reach = reach;
            bool all = true;
            for (int n = 0; all && n < kDirections; ++n) {
                const float angle = float(n) * float(2 * M_PI / kDirections);
                const Vec2f at = made.ends.nearest(reach * Vec2f(std::cos(angle), std::sin(angle)));
                all = isOnSurface(made.patch.voxel, seenFrom(made.patch, {}, at).patch.foot,
                                  kOffReach);
            }
            if (all) return reach;
        }
        return 0;
    }

    void addEnd(Ended& made, const Face& q) const
    {
        SurfacePatch& p = made.patch;
        const Vec3f inPlane = q.normal - q.normal.dot(p.normal) * p.normal;
        const float sine = inPlane.norm();
        const float here = q.normal.dot(p.foot - q.point), there = p.normal.dot(q.point - p.foot);
        const float height = std::abs(here) > std::abs(there) ? here : there;
        if (!(std::abs(height) > kLeastHeight)) return;
        const float side = height < 0 ? 1.0f : -1.0f; // convex: beyond the other it ends
        const Vec3f outward = side / sine * inPlane;
        float at = -side * here / sine;
        for (int step = 0; step < kSteps; ++step)
            at -= side / sine * q.heightOf(p.foot + at * outward - sag(p, at, outward) * p.normal);
        if (!(at >= -kBeyond && at <= kFarthest)) return;
        const Vec3f across = p.normal.cross(p.tangent);
        const Vec2f flat(outward.dot(p.tangent), outward.dot(across));
        for (int k = 0; k < made.ends.count; ++k)
            if (made.ends.ends[std::size_t(k)].outward.dot(flat) > kSameSide) return;
        // Either foot may lie beside where a third plane ends the crease.
        const Vec3f beside = p.foot + at * outward;
        const Vec3f along = p.normal.cross(outward);
        if (!isOnSurface(p.voxel, beside, kOffSurface) &&
            !isOnSurface(p.voxel, beside + along.dot(q.point - beside) * along, kOffSurface))
            return;
        if (at < 0) made = seenFrom(p, made.ends, at * flat);
        const Vec3f along3 = p.normal.cross(outward);
        const float bend =
            side / sine *
            (curvatureAlong(*q.patch, along3) - q.normal.dot(p.normal) * curvatureAlong(p, along3));
        made.ends.ends[std::size_t(made.ends.count++)] = {
            flat, std::max(at, 0.0f), std::min(std::max(bend, -kMostBend), kMostBend)};
    }

    /// Whether the values about @a offset from @a voxel allow the surface to be there: no corner of
    /// its cell is farther from the surface than from that place.
    bool isOnSurface(const Coord& voxel, const Vec3f& offset, float off) const
    {
        const Vec3f low = offset.array().floor();
        const Coord corner = voxel.offsetBy(int(low.x()), int(low.y()), int(low.z()));
        std::array<float, 8> values;
        float slope = 0; // of a distance by any scale
        for (int n = 0; n < 8; ++n) {
            values[std::size_t(n)] = mAccess.getValue(corner.offsetBy(n >> 2, n >> 1 & 1, n & 1));
            for (const int axis : {1, 2, 4})
                if (n & axis)
                    slope = std::max(
                        slope, std::abs(values[std::size_t(n)] - values[std::size_t(n - axis)]));
        }
        for (int n = 0; n < 8; ++n) {
            const Vec3f from = low + Vec3f(float(n >> 2), float(n >> 1 & 1), float(n & 1)) - offset;
            if (!(std::abs(values[std::size_t(n)]) <= slope * (from.norm() + off))) return false;
        }
        return true;
    }

    const SurfacePatches& mPatches;
    PatchesAround mNear;
    openvdb::tree::ValueAccessor<const openvdb::FloatTree> mAccess;
    std::vector<Face> mFaces;
};

} // namespace

std::vector<bool> besideCreases(const SurfacePatches& patches, const PatchIndex& index)
{
    std::vector<bool> beside(patches.patches.size());
    PatchesAround around(index);
    for (std::size_t n = 0; n < patches.kinds.size(); ++n)
        if (patches.kinds[n] != PatchKind::Smooth)
            around.forEach(patches.patches[n].voxel, 1, [&](std::uint32_t m) { beside[m] = true; });
    return beside;
}

void endAtCreases(SurfacePatches& patches, const PatchIndex& index, const std::vector<bool>& beside,
                  const openvdb::FloatTree& tree, Progress& progress)
{
    std::vector<std::uint32_t> fair, rough;
    for (std::uint32_t n = 0; n < beside.size(); ++n)
        if (beside[n]) (patches.kinds[n] == PatchKind::Rough ? rough : fair).push_back(n);
    const auto results = [&](const std::vector<std::uint32_t>& numbers, auto f) {
        std::vector<Ended> made(numbers.size());
        tbb::parallel_for(tbb::blocked_range<std::size_t>(0, numbers.size(), 64),
                          [&](const tbb::blocked_range<std::size_t>& range) {
                              progress.check();
                              CreaseFinder finder(patches, index, tree);
                              for (std::size_t n = range.begin(); n < range.end(); ++n)
                                  made[n] = f(finder, numbers[n]);
                          });
        return made;
    };
    const auto end = [&](std::uint32_t n, const Ended& made) {
        patches.patches[n] = made.patch;
        patches.patches[n].ends = std::uint32_t(patches.ends.size());
        patches.ends.push_back(made.ends);
    };
    std::vector<Ended> made = results(fair, [](CreaseFinder& f, std::uint32_t n) {
        return Ended{f.bent(n), {}};
    });
    for (std::size_t n = 0; n < fair.size(); ++n) patches.patches[fair[n]] = made[n].patch;
    made = results(fair, [](CreaseFinder& f, std::uint32_t n) { return f.ended(n); });
    for (std::size_t n = 0; n < fair.size(); ++n) end(fair[n], made[n]);
    made = results(rough, [](CreaseFinder& f, std::uint32_t n) { return f.part(n); });
    for (std::size_t n = 0; n < rough.size(); ++n) end(rough[n], made[n]);
}

} // namespace mpuvdb
