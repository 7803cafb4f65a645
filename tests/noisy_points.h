// Points with noise, one by one.
#pragma once
#include "field_fixture.h"
#include "spatial/point_batch.h"

namespace mpuvdb::test
{

/// Of unit deviation: the sum of twelve, near enough.
inline double normalDraw(Random& random)
{
    double sum = -6;
    for (int i = 0; i < 12; ++i) sum += random.uniform();
    return sum;
}

inline void append(PointBatch& batch, const Vec3d& p, const Vec3d& n)
{
    const std::size_t i = batch.size();
    batch.resize(i + 1);
    batch.x[i] = float(p[0]), batch.y[i] = float(p[1]), batch.z[i] = float(p[2]);
    batch.nx[i] = float(n[0]), batch.ny[i] = float(n[1]), batch.nz[i] = float(n[2]);
    batch.confidence[i] = 1;
}

} // namespace mpuvdb::test
