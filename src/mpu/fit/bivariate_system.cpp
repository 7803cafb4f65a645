#include "bivariate_system.h"

#include "core/clones.h"
#include "spatial/point_group.h"

#include <cmath>

namespace mpuvdb
{
namespace
{

/// Coordinates of four vectors along a frame's axes.
struct Components {
    Group u, v, w;
};

[[gnu::always_inline]] inline Components along(const Frame& frame, const Group& x, const Group& y,
                                               const Group& z)
{
    return {x * frame.u[0] + y * frame.u[1] + z * frame.u[2],
            x * frame.v[0] + y * frame.v[1] + z * frame.v[2],
            x * frame.w[0] + y * frame.w[1] + z * frame.w[2]};
}

} // namespace

MPUVDB_WIDE_CLONES
BivariateSystem bivariateSystem(const CellPoints& points, const Frame& frame, const Vec3d& origin,
                                double totalWeight)
{
    BivariateSystem system;
    Group variance{};
    for (std::size_t i = 0; i < points.paddedCount(); i += CellPoints::kGroup) {
        const auto [u, v, w] = along(frame, load(points.x, i) - origin[0],
                                     load(points.y, i) - origin[1], load(points.z, i) - origin[2]);
        variance += load(points.weight, i) * (u * u + v * v);
    }
    const double mean = sum(variance) / totalWeight;
    if (!(mean > 1e-24 * points.radius * points.radius)) return system;
    const double t = system.scale = 1 / std::sqrt(mean);

    Group m[5][5] = {}, s[6] = {}; // m[a][b] = sum weight u^a v^b
    for (std::size_t i = 0; i < points.paddedCount(); i += CellPoints::kGroup) {
        const auto [u, v, w] =
            along(frame, t * (load(points.x, i) - origin[0]), t * (load(points.y, i) - origin[1]),
                  t * (load(points.z, i) - origin[2]));
        Group ua = load(points.weight, i);
        const Group powers[5] = {ua * 0 + 1, v, v * v, v * v * v, v * v * v * v};
        s[0] += ua * u * u * w;
        s[1] += ua * u * v * w;
        s[2] += ua * v * v * w;
        s[3] += ua * u * w;
        s[4] += ua * v * w;
        s[5] += ua * w;
        for (int a = 0; a < 5; ++a, ua *= u)
            for (int b = 0; a + b < 5; ++b) m[a][b] += ua * powers[b];
    }
    constexpr int ea[6] = {2, 1, 0, 1, 0, 0}, eb[6] = {0, 1, 2, 0, 1, 0};
    for (int i = 0; i < 6; ++i) {
        system.r[i] = sum(s[i]) / totalWeight;
        for (int j = 0; j < 6; ++j)
            system.M(i, j) = sum(m[ea[i] + ea[j]][eb[i] + eb[j]]) / totalWeight;
    }
    return system;
}

MPUVDB_WIDE_CLONES
void addSlopes(const CellPoints& points, const Frame& frame, const Vec3d& origin,
               double totalWeight, double lever, BivariateSystem& system)
{
    const double t = system.scale;
    // Moments 1, u, v, uu, uv, vv, and slopes along u and v times 1, u, v.
    Group m[6] = {}, su[3] = {}, sv[3] = {};
    for (std::size_t i = 0; i < points.paddedCount(); i += CellPoints::kGroup) {
        const auto [u, v, w] =
            along(frame, t * (load(points.x, i) - origin[0]), t * (load(points.y, i) - origin[1]),
                  t * (load(points.z, i) - origin[2]));
        const auto [nu, nv, nw] =
            along(frame, load(points.nx, i), load(points.ny, i), load(points.nz, i));
        // A tilt of the normal changes the slope by 1 / nw^2: half of that is in the weight.
        const Group weight = nw > kMinHeightCosine ? load(points.weight, i) * nw * nw : Group{};
        const Group slopeU = nw > kMinHeightCosine ? -nu / nw : Group{};
        const Group slopeV = nw > kMinHeightCosine ? -nv / nw : Group{};
        const Group wu = weight * u, wv = weight * v;
        m[0] += weight, m[1] += wu, m[2] += wv;
        m[3] += wu * u, m[4] += wu * v, m[5] += wv * v;
        su[0] += weight * slopeU, su[1] += wu * slopeU, su[2] += wv * slopeU;
        sv[0] += weight * slopeV, sv[1] += wu * slopeV, sv[2] += wv * slopeV;
    }
    const double share = lever * lever * t * t / totalWeight;
    double one = share * sum(m[0]), u = share * sum(m[1]), v = share * sum(m[2]),
           uu = share * sum(m[3]), uv = share * sum(m[4]), vv = share * sum(m[5]);
    // d/du of the basis u^2, uv, v^2, u, v: 2u, v, 0, 1, 0; d/dv: 0, u, 2v, 0, 1.
    Eigen::Matrix<double, 5, 5> S;
    S << 4 * uu, 2 * uv, 0, 2 * u, 0,  //
        2 * uv, uu + vv, 2 * uv, v, u, //
        0, 2 * uv, 4 * vv, 0, 2 * v,   //
        2 * u, v, 0, one, 0,           //
        0, u, 2 * v, 0, one;
    system.M.topLeftCorner<5, 5>() += S;
    Eigen::Matrix<double, 5, 1> r;
    r << 2 * sum(su[1]), sum(su[2]) + sum(sv[1]), 2 * sum(sv[2]), sum(su[0]), sum(sv[0]);
    system.r.head<5>() += share * r;
}

Quadric heightAbove(const Frame& frame, const Eigen::Matrix<double, 5, 1>& k, double scale)
{
    Quadric q;
    q.A = -scale * (k[0] * frame.u * frame.u.transpose() + k[2] * frame.v * frame.v.transpose() +
                    0.5 * k[1] * (frame.u * frame.v.transpose() + frame.v * frame.u.transpose()));
    q.b = frame.w - k[3] * frame.u - k[4] * frame.v;
    return q;
}

} // namespace mpuvdb
