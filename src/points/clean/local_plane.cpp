#include "local_plane.h"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <limits>

namespace mpuvdb
{
namespace
{

/// Members by their heights over planes through the first one.
class Heights
{
public:
    Heights(const std::vector<Vec3f>& positions, const std::vector<std::uint32_t>& members)
        : mApart(3, Eigen::Index(members.size())), mFewest(members.size() / 2 + 1)
    {
        for (std::size_t i = 0; i < members.size(); ++i)
            mApart.col(Eigen::Index(i)) = positions[members[i]] - positions[members.front()];
    }

    Eigen::Index size() const { return mApart.cols(); }
    Vec3f apart(Eigen::Index i) const { return mApart.col(i); }

    /// Whether more than half of the members are nearer to the plane than @a height; which is made
    /// the height that the nearer half reaches.
    bool lowers(const Vec3f& normal, float& height)
    {
        mHeights = (normal.transpose() * mApart).cwiseAbs();
        if (std::size_t((mHeights.array() < height).count()) < mFewest) return false;
        const auto half = mHeights.data() + mFewest - 1;
        std::nth_element(mHeights.data(), half, mHeights.data() + mHeights.size());
        height = *half;
        return true;
    }

    /// The members nearer to the plane than @a height, or exactly as near.
    std::vector<std::uint32_t> within(const Vec3f& normal, float height,
                                      const std::vector<std::uint32_t>& members)
    {
        mHeights = (normal.transpose() * mApart).cwiseAbs();
        std::vector<std::uint32_t> near;
        for (std::size_t i = 0; i < members.size(); ++i)
            if (mHeights[Eigen::Index(i)] <= height) near.push_back(members[i]);
        return near;
    }

private:
    Eigen::Matrix3Xf mApart;
    Eigen::RowVectorXf mHeights;
    std::size_t mFewest;
};

/// A plane through the first member and the height within which half of the members lie.
struct TriplePlane {
    Vec3f normal = Vec3f::Zero();
    float height = std::numeric_limits<float>::infinity();
};

/// Of the planes through the first member and two of the nearest, the one to which half of the
/// members are nearest [least median of squares, Rousseeuw84]; zero if none is a plane.
TriplePlane bestTriple(Heights& heights)
{
    constexpr Eigen::Index kNearest =
        9; // members; [tuned: clean_points_test, estimate_normals_test]
    // The least sine between two directions that make a plane. [tuned: estimate_normals_test]
    constexpr float kFlat = 0.2f;
    const Eigen::Index count = std::min(kNearest, heights.size());
    TriplePlane best;
    for (Eigen::Index j = 1; j < count; ++j)
        for (Eigen::Index k = j + 1; k < count; ++k) {
            const Vec3f a = heights.apart(j), b = heights.apart(k);
            const Vec3f across = a.cross(b);
            const float length = across.norm();
            if (!(length > kFlat * a.norm() * b.norm())) continue;
            const Vec3f normal = across / length;
            if (heights.lowers(normal, best.height)) best.normal = normal;
        }
    return best;
}

} // namespace

LocalPlane planeOf(const std::vector<Vec3f>& positions, const std::vector<std::uint32_t>& members)
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

bool liesFlat(const std::vector<Vec3f>& positions, std::size_t point,
              const std::vector<std::uint32_t>& neighbors, double reach)
{
    // The ratio of the standard deviations across and along. [derived: of ten points at random in a
    // ball, one in a few hundred sets is as flat]
    constexpr double kFlat = 0.3;
    // Heights over the plane, in standard deviations of it, and in parts of the reach. [tuned:
    // clean_points_test]
    constexpr double kOffScatter = 3, kOffReach = 0.25;
    const LocalPlane plane = planeOf(positions, neighbors);
    const double height = std::abs(plane.height(positions[point]));
    const double scatter = std::sqrt(plane.variances[0]);
    return scatter < kFlat * std::sqrt((plane.variances[1] + plane.variances[2]) / 2) &&
           height < std::max(kOffScatter * scatter, kOffReach * reach);
}

LocalPlane sheetPlaneOf(const std::vector<Vec3f>& positions,
                        const std::vector<std::uint32_t>& members, const LocalPlane& whole,
                        double noise)
{
    // Ratios of variances: of a thick plane, of the sheet's plane to that of all, and to that of
    // the noise. [tuned: estimate_normals_test]
    constexpr double kThick = 0.05, kThinner = 0.05, kNoises = 16;
    if (whole.variances[0] < kThick * whole.variances[1]) return whole;
    if (whole.variances[0] < kNoises * noise * noise) return whole;
    Heights heights(positions, members);
    const TriplePlane half = bestTriple(heights);
    if (half.normal == Vec3f::Zero()) return whole;
    // The height of a sheet's members, in that of the nearer half of all. [tuned:
    // estimate_normals_test]
    constexpr float kFarther = 2;
    const LocalPlane sheet =
        planeOf(positions, heights.within(half.normal, kFarther * half.height, members));
    // The least ratio of the variances along a sheet's plane: most members may lie on one contour,
    // whose own plane is not the surface's. [derived: half a disc, as beside an edge, has 0.28]
    constexpr double kSpanned = 0.1;
    if (sheet.variances[1] < kSpanned * sheet.variances[2]) return whole;
    const bool flat = sheet.variances[0] < kThick * sheet.variances[1];
    return flat && sheet.variances[0] < kThinner * whole.variances[0] ? sheet : whole;
}

} // namespace mpuvdb
