#include "point_batch.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace mpuvdb
{

void filterBall(const PointBatch& parent, const Vec3d& centre, double radius,
                std::vector<std::uint32_t>& indices, PointBatch& out)
{
    const std::size_t n = parent.size();
    indices.resize(n);
    const Vec3f c = centre.cast<float>();
    const float radius2 = float(radius * radius);
    std::size_t kept = 0;
    for (std::size_t i = 0; i < n; ++i) {
        const float dx = parent.x[i] - c[0], dy = parent.y[i] - c[1], dz = parent.z[i] - c[2];
        indices[kept] = std::uint32_t(i);
        kept += dx * dx + dy * dy + dz * dz < radius2;
    }
    out.resize(kept);
    const auto copy = [&](const std::vector<float>& from, std::vector<float>& to) {
        for (std::size_t i = 0; i < kept; ++i) to[i] = from[indices[i]];
    };
    copy(parent.x, out.x);
    copy(parent.y, out.y);
    copy(parent.z, out.z);
    copy(parent.nx, out.nx);
    copy(parent.ny, out.ny);
    copy(parent.nz, out.nz);
    copy(parent.confidence, out.confidence);
}

void takeStrided(const PointBatch& from, std::size_t stride, PointBatch& out)
{
    out.clear();
    for (std::size_t i = 0; i < from.size(); i += stride) out.append(from, i);
}

constexpr std::size_t kNeighbours = 12;

double measureSpacing(const PointBatch& ball, const Vec3d& centre, double radius)
{
    constexpr std::size_t kProbes = 3;
    const std::size_t n = ball.size();
    if (n <= kNeighbours) return 0;
    const auto squared = [&](const Vec3f& from, std::size_t i) {
        return (Vec3f(ball.x[i], ball.y[i], ball.z[i]) - from).squaredNorm();
    };
    const Vec3f c = centre.cast<float>();
    const float half2 = float(radius * radius / 4);
    std::vector<std::uint32_t> inner;
    for (std::uint32_t i = 0; i < n; ++i)
        if (squared(c, i) < half2) inner.push_back(i);
    if (inner.empty()) inner.push_back(std::uint32_t(n / 2));
    std::array<double, kProbes> found;
    std::vector<float> distance2(n);
    for (std::size_t probe = 0; probe < kProbes; ++probe) {
        const std::size_t p = inner[(2 * probe + 1) * inner.size() / (2 * kProbes)];
        const Vec3f from(ball.x[p], ball.y[p], ball.z[p]);
        for (std::size_t i = 0; i < n; ++i) distance2[i] = squared(from, i);
        std::nth_element(distance2.begin(), distance2.begin() + kNeighbours, distance2.end());
        found[probe] = std::sqrt(M_PI / kNeighbours * double(distance2[kNeighbours]));
    }
    std::sort(found.begin(), found.end());
    return found[kProbes / 2];
}

} // namespace mpuvdb
