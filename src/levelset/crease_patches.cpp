#include "crease_patches.h"

#include <mpuvdb/progress.h>

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

constexpr int kAround = 2;            ///< voxels about one whose planes are looked at
constexpr float kLeastSine = 0.2f;    ///< of two planes that meet in a crease
constexpr float kSameSide = 0.95f;    ///< cosine of ends that look the same way
constexpr float kFarthest = 2.2f;     ///< of a crease from a foot, voxels
constexpr float kBeyond = 0.8f;       ///< of a foot beyond a crease
constexpr float kLeastHeight = 0.02f; ///< of one foot above the other's plane, to tell the side
constexpr float kOffSurface = 0.35f;  ///< of a crease from the surface that the values tell
/// Of two places of one face: the cosine of their normals, and the height of one over the other.
constexpr float kSameFace = 0.9f, kOffFace = 0.5f;
constexpr float kFlat = 1e-3f, kRoughness = 0.05f, kMostTilt = 0.2f;
constexpr float kDamping = 1e-3f;
constexpr int kSteps = 2; ///< to where two bent patches meet
constexpr float kAside = 0.1f;
constexpr float kOffPatch = 0.4f;     ///< of a crossing from the patch that it belongs to

constexpr int kDim = 8;

/// Finds the patches of a leaf and of those around.
class Neighbourhood
{
public:
    /// Of all leaves.
    class Index
    {
    public:
        explicit Index(const SurfacePatches& patches)
        {
            for (std::size_t n = 0; n < patches.leaves.size(); ++n) {
                if (patches.first[n] == patches.first[n + 1]) continue;
                Entry& entry = mEntries[patches.leaves[n]->origin()];
                entry.first = patches.first[n];
                for (std::uint32_t m = patches.first[n]; m < patches.first[n + 1]; ++m) {
                    const auto voxel = Leaf::coordToOffset(patches.patches[m].voxel);
                    entry.voxels[voxel >> 6] |= std::uint64_t(1) << (voxel & 63);
                }
                for (std::size_t word = 1; word < kDim; ++word)
                    entry.before[word] =
                        std::uint16_t(entry.before[word - 1] +
                                      __builtin_popcountll(entry.voxels[word - 1]));
            }
        }

    private:
        friend class Neighbourhood;
        struct Entry {
            std::uint32_t first;
            std::array<std::uint64_t, kDim> voxels = {};
            std::array<std::uint16_t, kDim> before = {};
        };
        struct HashCoord {
            std::size_t operator()(const Coord& c) const { return c.hash<20>(); }
        };
        std::unordered_map<Coord, Entry, HashCoord> mEntries;
    };

    explicit Neighbourhood(const Index& index) : mIndex(index) {}

    /// Call f(number) for the patches of the voxels up to @a reach (at most 8) from @a voxel.
    template <typename F>
    void forEachAround(const Coord& voxel, int reach, F f)
    {
        moveTo(voxel & ~7);
        for (int x = -reach; x <= reach; ++x)
            for (int y = -reach; y <= reach; ++y)
                for (int z = -reach; z <= reach; ++z) {
                    const Coord at = voxel.offsetBy(x, y, z);
                    const Coord side = (at - mHome) >> 3;
                    const Index::Entry* const entry =
                        mAround[std::size_t(side[0] * 9 + side[1] * 3 + side[2] + 13)];
                    if (!entry) continue;
                    const auto n = Leaf::coordToOffset(at);
                    const std::uint64_t word = entry->voxels[n >> 6];
                    const std::uint64_t bit = std::uint64_t(1) << (n & 63);
                    if (!(word & bit)) continue;
                    f(entry->first + entry->before[n >> 6] +
                      std::uint32_t(__builtin_popcountll(word & (bit - 1))));
                }
    }

private:
    void moveTo(const Coord& home)
    {
        if (mAt && home == mHome) return;
        mAt = true;
        mHome = home;
        for (int n = 0; n < 27; ++n) {
            const auto found = mIndex.mEntries.find(
                home + Coord((n / 9 - 1) * kDim, (n / 3 % 3 - 1) * kDim, (n % 3 - 1) * kDim));
            mAround[std::size_t(n)] = found == mIndex.mEntries.end() ? nullptr : &found->second;
        }
    }

    const Index& mIndex;
    bool mAt = false;
    Coord mHome;
    std::array<const Index::Entry*, 27> mAround;
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
    CreaseFinder(const SurfacePatches& patches, const Neighbourhood::Index& index,
                 const openvdb::FloatTree& tree)
        : mPatches(patches), mNear(index), mAccess(tree)
    {
    }

    /// A patch with the ends where its plane meets those around.
    Ended end(std::uint32_t number)
    {
        Ended result{mPatches.patches[number], {}};
        collect(result.patch);
        for (const Face& q : mFaces) {
            if (result.ends.count == PatchEnds::kMost) break;
            addEnd(result, q);
        }
        return result;
    }

    /// A rough patch as a part of one with ends, if it lies on one.
    std::optional<Ended> part(std::uint32_t number)
    {
        const SurfacePatch& rough = mPatches.patches[number];
        std::optional<Ended> result;
        float least = std::numeric_limits<float>::infinity();
        mNear.forEachAround(rough.voxel, kAround, [&](std::uint32_t n) {
            const SurfacePatch& p = mPatches.patches[n];
            if (mPatches.kinds[n] == PatchKind::Rough || p.ends == SurfacePatch::kEndless) return;
            const PatchEnds& ends = mPatches.ends[p.ends];
            const Vec3f from = p.to(rough.voxel);
            const float off = p.distance(from + rough.foot, 1, &ends);
            if (ends.count == 0 || !(off <= kOffPatch)) return;
            const Vec3f across = p.normal.cross(p.tangent);
            const Vec2f at = ends.nearest({p.tangent.dot(from), across.dot(from)});
            Ended made = seenFrom(p, ends, at);
            const float score = off + kAside * at.norm();
            if (!(at.norm() <= kFarthest) || !(score < least)) return;
            least = score;
            made.patch.foot = -made.patch.to(rough.voxel);
            made.patch.voxel = rough.voxel;
            result = made;
        });
        return result;
    }

    /// A patch that is a plane by the values of one octant, as the feet around say that it bends.
    SurfacePatch bent(std::uint32_t number)
    {
        constexpr int kUnknowns = 6, kLeast = 9;
        using Matrix = Eigen::Matrix<float, kUnknowns, kUnknowns>;
        using Vector = Eigen::Matrix<float, kUnknowns, 1>;
        SurfacePatch patch = mPatches.patches[number];
        const Vec3f across = patch.normal.cross(patch.tangent);
        Matrix squares = Matrix::Zero();
        Vector pull = Vector::Zero();
        float sum = 0;
        int count = 0;
        mNear.forEachAround(patch.voxel, kAround, [&](std::uint32_t n) {
            if (mPatches.kinds[n] == PatchKind::Rough) return;
            const SurfacePatch& other = mPatches.patches[n];
            if (!(patch.normal.dot(other.normal) >= kSameFace)) return;
            const Vec3f to = -other.to(patch.voxel) - patch.foot;
            const float u = patch.tangent.dot(to), v = across.dot(to), w = patch.normal.dot(to);
            if (!(std::abs(w) <= kOffFace)) return;
            Vector row;
            row << 1, u, v, 0.5f * u * u, u * v, 0.5f * v * v;
            squares += row * row.transpose();
            pull += w * row;
            sum += w * w;
            ++count;
        });
        if (count < kLeast || sum <= kFlat * kFlat * float(count)) return patch;
        const Vector h = (squares + kDamping * Matrix::Identity()).ldlt().solve(pull);
        const float left = sum - 2 * h.dot(pull) + h.dot(squares * h);
        if (!(left <= kRoughness * kRoughness * float(count)) || !(std::abs(h[0]) <= kOffFace) ||
            !(std::hypot(h[1], h[2]) <= kMostTilt))
            return patch;
        patch.foot += h[0] * patch.normal;
        const Vec3f n = (patch.normal - h[1] * patch.tangent - h[2] * across).normalized();
        Eigen::Matrix3f hessian = Eigen::Matrix3f::Zero();
        const Vec3f t = patch.tangent;
        hessian -= h[3] * t * t.transpose() + h[4] * (t * across.transpose() + across * t.transpose()) +
                   h[5] * across * across.transpose();
        patch.normal = n;
        patch.bend(hessian, 0);
        return patch;
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
        made.patch.foot += beside - 0.5f * (p.curvature[0] * at[0] * at[0] +
                                            p.curvature[1] * at[1] * at[1]) *
                                        p.normal;
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
        mNear.forEachAround(patch.voxel, kAround, [&](std::uint32_t n) {
            if (mPatches.kinds[n] == PatchKind::Rough) return;
            const SurfacePatch& other = mPatches.patches[n];
            const Vec3f point = -other.to(patch.voxel);
            if (!(normalAt(patch, point).cross(other.normal).norm() >= kLeastSine)) return;
            mFaces.push_back({&other, point, other.normal, (point - patch.foot).squaredNorm()});
        });
        std::stable_sort(mFaces.begin(), mFaces.end(), [](const Face& a, const Face& b) {
            return a.distance2 < b.distance2;
        });
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
        if (!isOnSurface(p.voxel, beside) &&
            !isOnSurface(p.voxel, beside + along.dot(q.point - beside) * along))
            return;
        if (at < 0) made = seenFrom(p, made.ends, at * flat);
        const Vec3f along3 = p.normal.cross(outward);
        const float bend = side / sine *
                           (curvatureAlong(*q.patch, along3) -
                            q.normal.dot(p.normal) * curvatureAlong(p, along3));
        made.ends.ends[std::size_t(made.ends.count++)] = {flat, std::max(at, 0.0f), bend};
    }

    /// Whether the values about @a offset from @a voxel allow the surface to be there: no corner of
    /// its cell is farther from the surface than from that place.
    bool isOnSurface(const Coord& voxel, const Vec3f& offset) const
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
            if (!(std::abs(values[std::size_t(n)]) <= slope * (from.norm() + kOffSurface)))
                return false;
        }
        return true;
    }

    const SurfacePatches& mPatches;
    Neighbourhood mNear;
    openvdb::tree::ValueAccessor<const openvdb::FloatTree> mAccess;
    std::vector<Face> mFaces;
};

} // namespace

std::vector<bool> besideCreases(const SurfacePatches& patches)
{
    std::vector<bool> beside(patches.patches.size());
    const Neighbourhood::Index index(patches);
    Neighbourhood near(index);
    for (std::size_t n = 0; n < patches.kinds.size(); ++n)
        if (patches.kinds[n] != PatchKind::Smooth)
            near.forEachAround(patches.patches[n].voxel, 1,
                               [&](std::uint32_t m) { beside[m] = true; });
    return beside;
}

void endAtCreases(SurfacePatches& patches, const std::vector<bool>& beside,
                  const openvdb::FloatTree& tree, Progress& progress)
{
    const auto isRough = [&](std::uint32_t n) { return patches.kinds[n] == PatchKind::Rough; };
    const Neighbourhood::Index index(patches);
    std::vector<std::uint32_t> fair, rough;
    for (std::uint32_t n = 0; n < beside.size(); ++n)
        if (beside[n]) (isRough(n) ? rough : fair).push_back(n);
    const auto forEach = [&](const std::vector<std::uint32_t>& numbers, auto f) {
        tbb::parallel_for(tbb::blocked_range<std::size_t>(0, numbers.size(), 64),
                          [&](const tbb::blocked_range<std::size_t>& range) {
                              progress.check();
                              CreaseFinder finder(patches, index, tree);
                              for (std::size_t n = range.begin(); n < range.end(); ++n)
                                  f(finder, n);
                          });
    };
    std::vector<SurfacePatch> bent(fair.size());
    forEach(fair, [&](CreaseFinder& finder, std::size_t n) { bent[n] = finder.bent(fair[n]); });
    for (std::size_t n = 0; n < fair.size(); ++n) patches.patches[fair[n]] = bent[n];
    std::vector<Ended> ended(fair.size());
    forEach(fair, [&](CreaseFinder& finder, std::size_t n) { ended[n] = finder.end(fair[n]); });
    const auto set = [&](std::uint32_t n, const Ended& made) {
        patches.patches[n] = made.patch;
        patches.patches[n].ends = std::uint32_t(patches.ends.size());
        patches.ends.push_back(made.ends);
    };
    for (std::size_t n = 0; n < fair.size(); ++n) set(fair[n], ended[n]);
    std::vector<std::optional<Ended>> parts(rough.size());
    forEach(rough,
            [&](CreaseFinder& finder, std::size_t n) { parts[n] = finder.part(rough[n]); });
    for (std::size_t n = 0; n < rough.size(); ++n)
        set(rough[n], parts[n] ? *parts[n] : Ended{patches.patches[rough[n]], {}});
}

} // namespace mpuvdb
