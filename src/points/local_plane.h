// The plane of a few positions.
#pragma once
#include <mpuvdb/vec.h>

#include <Eigen/Eigenvalues>

#include <vector>

namespace mpuvdb
{

/// Least-squares plane: its middle, unit normal, and the variances of the positions along the
/// normal and along the two axes within the plane, ascending.
struct LocalPlane {
    Vec3d middle = Vec3d::Zero();
    Vec3d normal = Vec3d::UnitZ();
    Vec3d variances = Vec3d::Zero();

    double height(const Vec3f& p) const { return normal.dot(p.cast<double>() - middle); }
};

/// The plane of positions[members]; of less than two distinct ones any normal.
inline LocalPlane planeOf(const std::vector<Vec3f>& positions,
                          const std::vector<std::uint32_t>& members)
{
    const Vec3d base = positions[members.front()].cast<double>();
    Vec3d mean = Vec3d::Zero();
    for (const std::uint32_t m : members) mean += positions[m].cast<double>() - base;
    mean /= double(members.size());
    Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
    for (const std::uint32_t m : members) {
        const Vec3d d = positions[m].cast<double>() - base - mean;
        scatter += d * d.transpose();
    }
    LocalPlane plane;
    plane.middle = base + mean;
    // Scaled, because the direct solver works to absolute precision.
    const double size = scatter.trace();
    if (!(size > 0)) return plane;
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes;
    axes.computeDirect(scatter / size);
    plane.normal = axes.eigenvectors().col(0).normalized();
    plane.variances = axes.eigenvalues().cwiseMax(0) * (size / double(members.size()));
    return plane;
}

} // namespace mpuvdb
