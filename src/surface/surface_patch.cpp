#include "surface_patch.h"

#include <mpuvdb/error.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace mpuvdb
{
namespace
{

/// Distance to a curve of curvature @a k, in its plane, from @a height above a place on it and
/// @a along beside: exact for lines, circles and points.
float bent(float height, float along, float k)
{
    /// Smallest product of curvature and height. [derived: beyond half the way to a hollow's center
    /// another place is nearer]
    constexpr float kMinHollow = -0.5f;
    if (k * height < kMinHollow) k = kMinHollow / height;
    const float a = 1 + k * height, b = k * along;
    return (height * (1 + a) + b * along) / (std::sqrt(a * a + b * b) + 1);
}

} // namespace

SurfacePatch SurfacePatch::point(const openvdb::Coord& voxel, const Vec3f& foot)
{
    return {voxel, foot, Vec3f::UnitX(), Vec3f::UnitY(), {kPointCurvature, kPointCurvature}, 0};
}

std::array<float, 2> SurfacePatch::turnTangent(const Eigen::Matrix3f& hessian)
{
    const Vec3f a = normal.unitOrthogonal(), b = normal.cross(a);
    const Vec3f ha = hessian * a, hb = hessian * b;
    const float aa = a.dot(ha), ab = a.dot(hb), bb = b.dot(hb);
    const float angle = 0.5f * std::atan2(2 * ab, aa - bb);
    tangent = std::cos(angle) * a + std::sin(angle) * b;
    const float mean = 0.5f * (aa + bb), half = std::hypot(0.5f * (aa - bb), ab);
    return {mean + half, mean - half};
}

void SurfacePatch::bend(const Eigen::Matrix3f& hessian, float height)
{
    const std::array<float, 2> w = turnTangent(hessian);
    // Parallel surfaces: the radius shrinks by the height.
    for (std::size_t k = 0; k < 2; ++k)
        curvature[k] = w[k] / std::max(1 - height * w[k], 1 / kPointCurvature);
}

float SurfacePatch::distance(const Vec3f& from, float side) const
{
    const Vec3f across = normal.cross(tangent);
    const float height = side * normal.dot(from);
    const float along[2] = {tangent.dot(from), across.dot(from)};
    const float length = from.norm();
    if (height < 0) return length; // behind it: another part of the surface is nearer
    float shift[2];                // of the nearest place on the patch
    for (int n = 0; n < 2; ++n)
        shift[n] = along[n] / std::max(1 + side * curvature[n] * height, 0.5f);
    const float reached = std::hypot(shift[0], shift[1]);
    if (reached <= extent)
        return std::min(length, bent(bent(height, along[1], side * curvature[1]), along[0],
                                     side * curvature[0]));
    // From the place on the patch's rim in that direction.
    const float share = extent / reached;
    float square = 0, drop = 0; // of the place below the foot's plane
    for (int n = 0; n < 2; ++n) {
        const float to = share * shift[n], beside = along[n] - to;
        square += beside * beside;
        drop += 0.5f * side * curvature[n] * to * to;
    }
    return std::min(length, std::sqrt((height + drop) * (height + drop) + square));
}

Vec3f SurfacePatch::nearest(const Vec3f& from, float side) const
{
    const std::array<Vec3f, 2> axes = {tangent, normal.cross(tangent)};
    const float height = side * normal.dot(from);
    if (height < 0) return Vec3f::Zero(); // as in distance()
    float shift[2];
    for (std::size_t n = 0; n < 2; ++n)
        shift[n] = axes[n].dot(from) / std::max(1 + side * curvature[n] * height, 0.5f);
    const float reached = std::hypot(shift[0], shift[1]);
    const float share = reached > extent ? extent / reached : 1;
    Vec3f place = Vec3f::Zero();
    for (std::size_t n = 0; n < 2; ++n) {
        const float to = share * shift[n];
        place += to * axes[n] - 0.5f * curvature[n] * to * to * normal;
    }
    return place;
}

void requireIndexable(std::uint64_t patches)
{
    if (patches >= std::numeric_limits<std::uint32_t>::max())
        throw LimitError("the surface crosses more voxels than can be numbered (4e9): use larger "
                         "voxels");
}

} // namespace mpuvdb
