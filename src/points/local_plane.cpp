#include "local_plane.h"

#include <Eigen/Dense>

#include <algorithm>
#include <limits>

namespace mpuvdb
{
namespace
{

/// Members by their squared heights over planes through the first one.
class Heights
{
public:
    Heights(const std::vector<Vec3f>& positions, const std::vector<std::uint32_t>& members)
        : mSquared(members.size()), mFewest(members.size() / 2 + 1)
    {
        mApart.reserve(members.size());
        for (const std::uint32_t m : members)
            mApart.push_back(positions[m] - positions[members.front()]);
    }

    const std::vector<Vec3f>& apart() const { return mApart; }

    /// Sum of the squared heights of that half which is nearest to the plane.
    float nearerHalf(const Vec3f& normal)
    {
        for (std::size_t i = 0; i < mApart.size(); ++i) {
            const float height = normal.dot(mApart[i]);
            mSquared[i] = height * height;
        }
        const auto half = mSquared.begin() + std::ptrdiff_t(mFewest);
        std::nth_element(mSquared.begin(), half - 1, mSquared.end());
        float sum = 0;
        for (auto h = mSquared.begin(); h != half; ++h) sum += *h;
        return sum;
    }

    /// The members of that half, and those not much farther off.
    std::vector<std::uint32_t> onSheet(const Vec3f& normal,
                                       const std::vector<std::uint32_t>& members)
    {
        constexpr float kFarther = 9; // ratio of squares, against the half's mean
        const float limit = kFarther * nearerHalf(normal) / float(mFewest);
        const float half = mSquared[mFewest - 1];
        std::vector<std::uint32_t> sheet;
        for (std::size_t i = 0; i < members.size(); ++i) {
            const float height = normal.dot(mApart[i]);
            if (height * height <= std::max(limit, half)) sheet.push_back(members[i]);
        }
        return sheet;
    }

private:
    std::vector<Vec3f> mApart;
    std::vector<float> mSquared;
    std::size_t mFewest;
};

/// Of the planes through the first member and two of the nearest, the one that half of the members
/// are nearest to [least trimmed squares, Rousseeuw84]; zero if none is a plane.
Vec3f bestTriple(Heights& heights)
{
    constexpr std::size_t kNearest = 9;
    constexpr float kFlat = 0.2f; // sine
    const std::vector<Vec3f>& apart = heights.apart();
    const std::size_t count = std::min(kNearest, apart.size());
    Vec3f best = Vec3f::Zero();
    float least = std::numeric_limits<float>::infinity();
    for (std::size_t j = 1; j < count; ++j)
        for (std::size_t k = j + 1; k < count; ++k) {
            const Vec3f across = apart[j].cross(apart[k]);
            const float length = across.norm();
            if (!(length > kFlat * apart[j].norm() * apart[k].norm())) continue;
            const Vec3f normal = across / length;
            const float sum = heights.nearerHalf(normal);
            if (sum < least) {
                least = sum;
                best = normal;
            }
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

LocalPlane sheetPlaneOf(const std::vector<Vec3f>& positions,
                        const std::vector<std::uint32_t>& members, const LocalPlane& whole,
                        double noise)
{
    constexpr double kThick = 0.05, kThinner = 0.1, kNoises = 9; // ratios of squares
    if (whole.variances[0] < kThick * whole.variances[1]) return whole;
    if (whole.variances[0] < kNoises * noise * noise) return whole;
    Heights heights(positions, members);
    const Vec3f normal = bestTriple(heights);
    if (normal == Vec3f::Zero()) return whole;
    const LocalPlane sheet = planeOf(positions, heights.onSheet(normal, members));
    const bool flat = sheet.variances[0] < kThick * sheet.variances[1];
    return flat && sheet.variances[0] < kThinner * whole.variances[0] ? sheet : whole;
}

} // namespace mpuvdb
