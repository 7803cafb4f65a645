// A crossing lies on the face of a nearby patch. Where several faces cross an edge, the one with
// the nearest foot is chosen unless another cuts it off: in a ridge the face that is met first from
// inside, in a groove the last.
#include "face_crossings.h"

#include <algorithm>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;

/// Largest distance of a crossing beyond the edge's ends, voxels. [tuned: offset_bench]
constexpr float kMaxBeyondEdge = 0.02f;
/// Smallest cosine between the edge and a face's normal. [tuned: offset_bench]
constexpr float kMinCosine = 0.05f;
/// Largest distance of a crossing from a patch's foot, voxels. [tuned: offset_bench]
constexpr float kMaxFootDistance = 2.5f;
constexpr float kBallAllowance = 0.2f; ///< reduction of EmptyBalls, voxels [tuned: offset_bench]
/// Cosine above which normals belong to one face. [tuned: offset_bench]
constexpr float kSameFaceCosine = 0.995f;
/// Smallest height of one foot over the other's plane, voxels, by which a ridge differs from a
/// groove. [tuned: offset_bench]
constexpr float kMinHeight = 0.02f;

/// Corner n of the four cells about an edge along @a axis, relative to its first voxel.
Coord aroundEdge(int n, int axis)
{
    Coord c;
    c[(axis + 1) % 3] = n / 6 - 1;
    c[(axis + 2) % 3] = n / 2 % 3 - 1;
    c[axis] = n % 2;
    return c;
}

/// Voxels about an edge from (0,0,0) to (1,0,0), the nearest first.
std::array<Coord, 36> nearestFirst()
{
    std::array<Coord, 36> all;
    std::size_t count = 0;
    for (int x = -1; x <= 2; ++x)
        for (int y = -1; y <= 1; ++y)
            for (int z = -1; z <= 1; ++z) all[count++] = {x, y, z};
    const auto distance2 = [](const Coord& c) {
        const int beyond = std::max({-c[0], c[0] - 1, 0});
        return beyond * beyond + c[1] * c[1] + c[2] * c[2];
    };
    std::stable_sort(all.begin(), all.end(),
                     [&](const Coord& a, const Coord& b) { return distance2(a) < distance2(b); });
    return all;
}

} // namespace

/// The crossing of a patch's face with an edge, if there is one.
std::optional<FaceCrossings::Candidate>
FaceCrossings::candidate(const Coord& voxel, int axis, bool rising, const SurfacePatch& patch) const
{
    constexpr int kNewtonSteps = 2;  ///< number of steps after the first [tuned: offset_bench]
    constexpr float kMaxTurn = 0.3f; ///< change of the cosine by curvature [tuned: offset_bench]
    const float steep = rising ? patch.normal[axis] : -patch.normal[axis];
    if (!(steep >= kMinCosine - kMaxTurn)) return std::nullopt;
    const Vec3f start = patch.to(voxel), across = patch.normal.cross(patch.tangent);
    float at = 0;
    Vec3f to, normal;
    for (int step = 0; step <= kNewtonSteps; ++step) {
        to = start;
        to[axis] += at;
        const float u = patch.tangent.dot(to), v = across.dot(to);
        const float bendU = patch.curvature[0] * u, bendV = patch.curvature[1] * v;
        normal = patch.normal + bendU * patch.tangent + bendV * across;
        if (!((rising ? normal[axis] : -normal[axis]) >= kMinCosine)) return std::nullopt;
        at -= (patch.normal.dot(to) + 0.5f * (bendU * u + bendV * v)) / normal[axis];
        if (!(at >= -1 && at <= 2)) return std::nullopt;
    }
    if (!(at >= -kMaxBeyondEdge && at <= 1 + kMaxBeyondEdge)) return std::nullopt;
    to = start;
    to[axis] += at;
    const float aside = (to - patch.normal.dot(to) * patch.normal).norm();
    if (!(aside <= kMaxFootDistance)) return std::nullopt;
    return Candidate{rising ? at : 1 - at, aside, Vec3f(-start), at * Vec3f::Unit(axis),
                     normal.normalized()};
}

/// Collect one candidate for each nearby face, from the patch whose voxel is nearest to the edge.
void FaceCrossings::collect(const Coord& voxel, int axis, bool rising)
{
    Coord next = voxel;
    next[axis] += 1;
    const float slope = std::max(mValues.slopeAt(voxel), mValues.slopeAt(next));
    EmptyBalls empty(slope, kBallAllowance);
    for (int n = 0; n < 18; ++n) {
        const Coord around = aroundEdge(n, axis);
        empty.add(around, mValues.at(voxel + around));
    }
    mCandidates.clear();
    static const std::array<Coord, 36> kOrder = nearestFirst();
    for (const Coord& step : kOrder) {
        Coord at = voxel;
        for (int k = 0; k < 3; ++k) at[(axis + k) % 3] += step[k];
        const std::uint32_t n = mNumbers[at];
        if (n == VoxelIndex::kNone || mPatches.kinds[n] == PatchKind::Rough) continue;
        const Vec3f& normal = mPatches.patches[n].normal;
        if (std::any_of(mCandidates.begin(), mCandidates.end(),
                        [&](const Candidate& c) { return c.normal.dot(normal) > kSameFaceCosine; }))
            continue;
        const auto found = candidate(voxel, axis, rising, mPatches.patches[n]);
        if (found && !empty.contain(found->point)) mCandidates.push_back(*found);
    }
}

FaceCrossing FaceCrossings::find(const Coord& voxel, int axis)
{
    collect(voxel, axis, mValues.at(voxel) < 0);
    if (mCandidates.empty()) return interpolated(voxel, axis);
    std::stable_sort(mCandidates.begin(), mCandidates.end(),
                     [](const Candidate& a, const Candidate& b) { return a.aside < b.aside; });
    const Candidate* taken = &mCandidates.front();
    for (const Candidate& c : mCandidates) {
        const float here = taken->normal.dot(c.foot - taken->foot),
                    there = c.normal.dot(taken->foot - c.foot);
        const float height = std::abs(here) > std::abs(there) ? here : there;
        if (std::abs(height) > kMinHeight && (c.at < taken->at) == (height < 0)) taken = &c;
    }
    return {taken->point, taken->normal};
}

/// The crossing by linear interpolation, with the gradient at the end where its length is nearer to
/// the slope; through a wall or a gap, whose two sides the ends belong to, that of one of them.
FaceCrossing FaceCrossings::interpolated(const Coord& voxel, int axis) const
{
    /// Error of a gradient's length, relative to the slope. [tuned: offset_bench]
    constexpr float kMaxGradientError = 0.3f;
    Coord next = voxel;
    next[axis] += 1;
    const float low = mValues.at(voxel), high = mValues.at(next);
    FaceCrossing crossing;
    crossing.point[axis] = low / (low - high);
    const bool rises = low < 0;
    const OctantPlane first = mValues.planeAt(voxel), second = mValues.planeAt(next);
    if (first.normal.dot(second.normal) < 0) {
        const PlaneCrossing side = crossingByPlanes(rises ? first : second, rises ? second : first,
                                                    (rises ? 1.0f : -1.0f) * Vec3f::Unit(axis));
        if (side.plane) {
            crossing.point[axis] = std::clamp(rises ? side.at : 1 - side.at, 0.0f, 1.0f);
            crossing.normal = side.plane->normal;
            return crossing;
        }
    }
    float least = kMaxGradientError;
    for (const Coord& end : {voxel, next}) {
        const Vec3f gradient = mValues.gradientAt(end);
        const float length = gradient.norm(), off = std::abs(length / mValues.slopeAt(end) - 1);
        if (!(off < least) || !((high - low) * gradient[axis] > 0)) continue;
        least = off;
        crossing.normal = gradient / length;
    }
    return crossing;
}

} // namespace mpuvdb
