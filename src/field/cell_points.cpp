#include "cell_points.h"

#include "point_group.h"
#include "quadric.h"

#include <mpuvdb/clones.h>

#include <cmath>

namespace mpuvdb
{

void CellPoints::setCount(std::size_t n)
{
    count = n;
    const std::size_t padded = (n + kGroup - 1) / kGroup * kGroup;
    for (auto* a : {&x, &y, &z, &nx, &ny, &nz, &weight, &confidence}) a->resize(padded);
}

// No nearer to anything than the points.
void CellPoints::pad()
{
    for (std::size_t i = count; i < x.size(); ++i) {
        for (auto* a : {&x, &y, &z, &nx, &ny, &nz}) (*a)[i] = (*a)[count - 1];
        weight[i] = confidence[i] = 0;
    }
}

MPUVDB_CLONES
void CellPoints::assign(const PointBatch& batch, const Vec3d& centre, double ballRadius)
{
    setCount(batch.size());
    radius = ballRadius;
    const auto copy = [n = count](const PointBatch::Floats& from, std::vector<double>& to,
                                  double origin) {
        for (std::size_t i = 0; i < n; ++i) to[i] = double(from[i]) - origin;
    };
    copy(batch.x, x, centre[0]);
    copy(batch.y, y, centre[1]);
    copy(batch.z, z, centre[2]);
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

MPUVDB_CLONES
void CellPoints::weighAcross(const Vec3d& normal, double reach)
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
