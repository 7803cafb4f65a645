// What nobody saw: the part of a mesh that is far from the points it was made of.
#pragma once
#include "spatial/kd_tree.h"

#include <mpuvdb/mesh.h>
#include <mpuvdb/point_cloud.h>
#include <mpuvdb/scan_sampler.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace mpuvdb::test
{

/// Three spacings of @a cloud on the surface that is @a mesh.
inline double farFrom(const PointCloud& cloud, const Mesh& mesh)
{
    return 3 * std::sqrt(measure(mesh).area / double(cloud.size()));
}

/// Call f(triangle, its corners, its area) for those @a far from the points and farther.
template <typename F>
void forEachUnseen(const Mesh& mesh, const PointCloud& cloud, double far, F f)
{
    const KdTree points(cloud.positions);
    std::vector<std::uint32_t> nearest(1);
    std::vector<float> squared(1);
    for (const Mesh::Triangle& t : mesh.triangles) {
        const std::array<Vec3d, 3> p{mesh.world(t[0]), mesh.world(t[1]), mesh.world(t[2])};
        points.nearest(((p[0] + p[1] + p[2]) / 3 - cloud.frame).cast<float>(), nearest, squared);
        if (double(squared[0]) >= far * far) f(t, p, (p[1] - p[0]).cross(p[2] - p[0]).norm() / 2);
    }
}

/// How far the unseen part of a mesh is from the truth.
struct Unseen {
    double share = 0;             ///< of the area
    double mean = 0, largest = 0; ///< distance from the solid, world units
};

inline Unseen unseenPart(const Mesh& mesh, const Solid& solid, const PointCloud& cloud, double far)
{
    Unseen result;
    double unseen = 0;
    forEachUnseen(mesh, cloud, far, [&](const auto&, const auto& p, double area) {
        const double distance = std::abs(solid.distance((p[0] + p[1] + p[2]) / 3));
        unseen += area;
        result.mean += area * distance;
        result.largest = std::max(result.largest, distance);
    });
    if (unseen > 0) result.mean /= unseen;
    result.share = unseen / measure(mesh).area;
    return result;
}

} // namespace mpuvdb::test
