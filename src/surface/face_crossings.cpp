// A crossing lies on the face of a patch near by. Where several faces cross an edge, the nearest is
// right unless another cuts it off before: the one met first from inside where the two meet in a
// ridge, and the last where they meet in a groove.
#include "face_crossings.h"

#include <algorithm>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;

constexpr float kBeyond = 0.02f;      ///< of an edge's ends, voxels
constexpr float kLeastSlope = 0.05f;  ///< of a face against an edge: cosine to its normal
constexpr float kMostAside = 2.5f;    ///< of a crossing from a patch's foot, voxels
constexpr float kMostTooNear = 0.2f;  ///< of a crossing, voxels
constexpr float kSameFace = 0.995f;   ///< cosine of normals
constexpr float kLeastHeight = 0.02f; ///< of one foot above the other's plane, to tell the side

/// Corners of the cells about an edge along z, in the order of x, y, z.
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

/// Where the face of a patch crosses an edge.
std::optional<FaceCrossings::Candidate>
FaceCrossings::candidate(const Coord& voxel, int axis, bool rising, const SurfacePatch& patch) const
{
    constexpr int kSteps = 2;
    constexpr float kMostTurn = 0.3f; // of a face, by its bend
    const float steep = rising ? patch.normal[axis] : -patch.normal[axis];
    if (!(steep >= kLeastSlope - kMostTurn)) return std::nullopt;
    const Vec3f start = patch.to(voxel), across = patch.normal.cross(patch.tangent);
    float at = 0;
    Vec3f to, normal;
    for (int step = 0; step <= kSteps; ++step) {
        to = start;
        to[axis] += at;
        const float u = patch.tangent.dot(to), v = across.dot(to);
        const float bendU = patch.curvature[0] * u, bendV = patch.curvature[1] * v;
        normal = patch.normal + bendU * patch.tangent + bendV * across;
        if (!((rising ? normal[axis] : -normal[axis]) >= kLeastSlope)) return std::nullopt;
        at -= (patch.normal.dot(to) + 0.5f * (bendU * u + bendV * v)) / normal[axis];
        if (!(at >= -1 && at <= 2)) return std::nullopt;
    }
    if (!(at >= -kBeyond && at <= 1 + kBeyond)) return std::nullopt;
    to = start;
    to[axis] += at;
    const float aside = (to - patch.normal.dot(to) * patch.normal).norm();
    if (!(aside <= kMostAside)) return std::nullopt;
    return Candidate{rising ? at : 1 - at, aside, Vec3f(-start), at * Vec3f::Unit(axis),
                     normal.normalized()};
}

/// One candidate for each face near by, from the patch whose voxel is nearest to the edge.
void FaceCrossings::collect(const Coord& voxel, int axis, bool rising)
{
    Coord next = voxel;
    next[axis] += 1;
    const float slope = std::max(mValues.slopeAt(voxel), mValues.slopeAt(next));
    EmptyBalls empty(slope, kMostTooNear);
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
                        [&](const Candidate& c) { return c.normal.dot(normal) > kSameFace; }))
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
        if (std::abs(height) > kLeastHeight && (c.at < taken->at) == (height < 0)) taken = &c;
    }
    return {taken->point, taken->normal};
}

/// What the values on the edge tell, and the gradient at that of its ends where it is more like a
/// distance's.
FaceCrossing FaceCrossings::interpolated(const Coord& voxel, int axis) const
{
    constexpr float kMostOff = 0.3f; // of a gradient's length, relative to the slope
    Coord next = voxel;
    next[axis] += 1;
    const float low = mValues.at(voxel), high = mValues.at(next);
    FaceCrossing crossing;
    crossing.point[axis] = low / (low - high);
    float least = kMostOff;
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
