#include "cell_points.h"

#include "core/clones.h"
#include "quadric.h"
#include "spatial/point_group.h"

#include <algorithm>
#include <cmath>

namespace mpuvdb
{

void CellPoints::setCount(std::size_t n)
{
    count = n;
    const std::size_t padded = (n + kGroup - 1) / kGroup * kGroup;
    for (auto* a : {&x, &y, &z, &nx, &ny, &nz, &weight, &confidence}) a->resize(padded);
}

void CellPoints::pad()
{
    for (std::size_t i = count; i < x.size(); ++i) {
        for (auto* a : {&x, &y, &z, &nx, &ny, &nz}) (*a)[i] = (*a)[count - 1];
        weight[i] = confidence[i] = 0;
    }
}

MPUVDB_WIDE_CLONES
void CellPoints::assign(const PointBatch& batch, const Vec3d& center, double ballRadius)
{
    setCount(batch.size());
    radius = ballRadius;
    const auto copy = [n = count](const PointBatch::Floats& from, UnsetVector<double>& to,
                                  double origin) {
        for (std::size_t i = 0; i < n; ++i) to[i] = double(from[i]) - origin;
    };
    copy(batch.x, x, center[0]);
    copy(batch.y, y, center[1]);
    copy(batch.z, z, center[2]);
    copy(batch.nx, nx, 0);
    copy(batch.ny, ny, 0);
    copy(batch.nz, nz, 0);
    copy(batch.confidence, confidence, 0);
    pad();
    const double scale = 1.5 / ballRadius;
    for (std::size_t i = 0; i < x.size(); i += kGroup) {
        const Group gx = load(x, i), gy = load(y, i), gz = load(z, i);
        const Group t = squareRoot(gx * gx + gy * gy + gz * gz) * scale;
        const Group w = load(confidence, i) * bsplineWeight(t);
        std::memcpy(&weight[i], &w, sizeof w);
    }
}

MPUVDB_WIDE_CLONES
void CellPoints::weightLaterally(const Vec3d& normal, double reach)
{
    const double scale = 1.5 / reach;
    for (std::size_t i = 0; i < x.size(); i += kGroup) {
        const Group gx = load(x, i), gy = load(y, i), gz = load(z, i);
        const Group along = gx * normal[0] + gy * normal[1] + gz * normal[2];
        const Group across2 = gx * gx + gy * gy + gz * gz - along * along;
        const Group t = squareRoot(across2 > 0 ? across2 : Group{}) * scale;
        const Group w = load(confidence, i) * bsplineWeight(t);
        std::memcpy(&weight[i], &w, sizeof w);
    }
}

MPUVDB_WIDE_CLONES
void CellPoints::projectLaterally(const Quadric& q, const Vec3d& normal, double farthest)
{
    constexpr int kFootSteps = 3; ///< steps to a foot [tuned: noise_bench]
    /// Groups at once: a single one waits for its divisions. [free: time]
    constexpr std::size_t kGroups = 2;
    const auto& A = q.A;
    const Group steep = Group{} + kMinHeightCosine;
    for (std::size_t i = 0; i < x.size(); i += kGroups * kGroup) {
        const std::size_t at[kGroups] = {i, std::min(i + kGroup, x.size() - kGroup)};
        Group px[kGroups], py[kGroups], pz[kGroups], fx[kGroups], fy[kGroups], fz[kGroups];
        Group gx[kGroups], gy[kGroups], gz[kGroups], slope2[kGroups], above[kGroups];
        for (std::size_t n = 0; n < kGroups; ++n) {
            fx[n] = px[n] = load(x, at[n]);
            fy[n] = py[n] = load(y, at[n]);
            fz[n] = pz[n] = load(z, at[n]);
        }
        // The point's height over the tangent plane at the foot, times the slope there.
        const auto look = [&](std::size_t n) __attribute__((always_inline))
        {
            const Group ax = A(0, 0) * fx[n] + A(0, 1) * fy[n] + A(0, 2) * fz[n],
                        ay = A(1, 0) * fx[n] + A(1, 1) * fy[n] + A(1, 2) * fz[n],
                        az = A(2, 0) * fx[n] + A(2, 1) * fy[n] + A(2, 2) * fz[n];
            const Group value =
                fx[n] * (ax + q.b[0]) + fy[n] * (ay + q.b[1]) + fz[n] * (az + q.b[2]) + q.c;
            gx[n] = 2 * ax + q.b[0];
            gy[n] = 2 * ay + q.b[1];
            gz[n] = 2 * az + q.b[2];
            slope2[n] = gx[n] * gx[n] + gy[n] * gy[n] + gz[n] * gz[n] + 1e-30;
            above[n] =
                (px[n] - fx[n]) * gx[n] + (py[n] - fy[n]) * gy[n] + (pz[n] - fz[n]) * gz[n] + value;
        };
        const auto step = [&](std::size_t n) __attribute__((always_inline))
        {
            const Group share = above[n] / slope2[n];
            fx[n] = px[n] - share * gx[n];
            fy[n] = py[n] - share * gy[n];
            fz[n] = pz[n] - share * gz[n];
        };
        for (int s = 0; s < kFootSteps; ++s) {
            look(0), look(1);
            step(0), step(1);
        }
        look(0), look(1);
        for (std::size_t n = 0; n < kGroups; ++n) {
            const Group scale = 1 / squareRoot(slope2[n]), off = above[n] * scale;
            const Group across =
                (gx[n] * normal[0] + gy[n] * normal[1] + gz[n] * normal[2]) * scale;
            step(n);
            const Group height = off / (across > steep ? across : steep);
            const auto near = off * off < farthest * farthest;
            const Group mx = near ? fx[n] + height * normal[0] : px[n],
                        my = near ? fy[n] + height * normal[1] : py[n],
                        mz = near ? fz[n] + height * normal[2] : pz[n];
            std::memcpy(&x[at[n]], &mx, sizeof mx);
            std::memcpy(&y[at[n]], &my, sizeof my);
            std::memcpy(&z[at[n]], &mz, sizeof mz);
        }
    }
}

void CellPoints::assignSubset(const CellPoints& other, const std::vector<std::uint32_t>& members)
{
    setCount(members.size());
    radius = other.radius;
    for (std::size_t i = 0; i < count; ++i) {
        const std::uint32_t m = members[i];
        x[i] = other.x[m];
        y[i] = other.y[m];
        z[i] = other.z[m];
        nx[i] = other.nx[m];
        ny[i] = other.ny[m];
        nz[i] = other.nz[m];
        confidence[i] = other.confidence[m];
        weight[i] = other.weight[m];
    }
    pad();
}

MPUVDB_WIDE_CLONES
Vec3d meanNormal(const CellPoints& points)
{
    Group sx{}, sy{}, sz{};
    for (std::size_t i = 0; i < points.paddedCount(); i += CellPoints::kGroup) {
        const Group w = load(points.weight, i);
        sx += w * load(points.nx, i);
        sy += w * load(points.ny, i);
        sz += w * load(points.nz, i);
    }
    const Vec3d total(sum(sx), sum(sy), sum(sz));
    const double length = total.norm();
    return length > 0 ? Vec3d(total / length) : Vec3d(0, 0, 1);
}

} // namespace mpuvdb
