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
constexpr float kLeastSine = 0.1f;    ///< of two faces
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

} // namespace

/// Where the face of a patch crosses an edge.
std::optional<FaceCrossings::Candidate>
FaceCrossings::candidate(const Coord& voxel, int axis, bool rising, const SurfacePatch& patch) const
{
    constexpr int kSteps = 2;
    const Vec3f across = patch.normal.cross(patch.tangent);
    const Vec3f start = patch.to(voxel), along = Vec3f::Unit(axis);
    float at = 0;
    Vec3f to, normal = patch.normal;
    for (int step = 0; step <= kSteps; ++step) {
        to = start + at * along;
        const float u = patch.tangent.dot(to), v = across.dot(to);
        normal =
            patch.normal + patch.curvature[0] * u * patch.tangent + patch.curvature[1] * v * across;
        const float height =
            patch.normal.dot(to) + 0.5f * (patch.curvature[0] * u * u + patch.curvature[1] * v * v);
        const float slope = normal.dot(along);
        if (!((rising ? slope : -slope) >= kLeastSlope)) return std::nullopt;
        at -= height / slope;
        if (!(at >= -1 && at <= 2)) return std::nullopt;
    }
    if (!(at >= -kBeyond && at <= 1 + kBeyond)) return std::nullopt;
    to = start + at * along;
    const float aside = (to - patch.normal.dot(to) * patch.normal).norm();
    if (!(aside <= kMostAside)) return std::nullopt;
    return Candidate{rising ? at : 1 - at, aside, Vec3f(-start), at * along, normal.normalized()};
}

FaceCrossing FaceCrossings::find(const Coord& voxel, int axis)
{
    Coord next = voxel;
    next[axis] += 1;
    const float low = mValues.at(voxel), high = mValues.at(next);
    const bool rising = low < 0;
    std::array<Coord, 18> around;
    for (int n = 0; n < 18; ++n) around[std::size_t(n)] = aroundEdge(n, axis);
    const float slope = std::max(mValues.slopeAt(voxel), mValues.slopeAt(next));
    mCandidates.clear();
    for (int x = -1; x <= 1; ++x)
        for (int y = -1; y <= 1; ++y)
            for (int z = -1; z <= 2; ++z) {
                Coord at = voxel;
                at[(axis + 1) % 3] += x;
                at[(axis + 2) % 3] += y;
                at[axis] += z;
                const std::uint32_t n = mNumbers[at];
                if (n == VoxelNumbers::kNone || mPatches.kinds[n] == PatchKind::Rough) continue;
                const auto found = candidate(voxel, axis, rising, mPatches.patches[n]);
                if (found) mCandidates.push_back(*found);
            }
    std::stable_sort(mCandidates.begin(), mCandidates.end(),
                     [](const Candidate& a, const Candidate& b) { return a.aside < b.aside; });
    const Candidate* taken = nullptr;
    for (const Candidate& c : mCandidates) {
        if (taken) {
            if (!(taken->normal.cross(c.normal).norm() >= kLeastSine)) continue;
            const float here = taken->normal.dot(c.foot - taken->foot),
                        there = c.normal.dot(taken->foot - c.foot);
            const float height = std::abs(here) > std::abs(there) ? here : there;
            if (!(std::abs(height) > kLeastHeight) || (c.at < taken->at) != (height < 0)) continue;
        }
        if (tooNear(voxel, c.point, slope, around.data(), 18) > kMostTooNear) continue;
        taken = &c;
    }
    FaceCrossing crossing;
    if (taken) {
        crossing.point = taken->point;
        crossing.normal = taken->normal;
    } else {
        crossing.point[axis] = low / (low - high);
    }
    return crossing;
}

float FaceCrossings::tooNear(const Coord& voxel, const Vec3f& place, float slope,
                             const Coord* around, int count) const
{
    float most = 0;
    for (int n = 0; n < count; ++n) {
        const Vec3f from =
            Vec3f(float(around[n][0]), float(around[n][1]), float(around[n][2])) - place;
        // Of a distance by any scale.
        most = std::max(most, std::abs(mValues.at(voxel + around[n])) - slope * from.norm());
    }
    return most / std::max(slope, 1e-6f);
}

} // namespace mpuvdb
