// A cell of an octree for tests of what is fitted to one.
#pragma once
#include "mpu/fit/local_fit.h"

#include <vector>

namespace mpuvdb::test
{

/// The cell's points in double precision, weighted as CellPoints::assign does.
inline CellPoints cellOf(const std::vector<Vec3d>& positions, const std::vector<Vec3d>& normals,
                         double radius, double confidence = 1)
{
    CellPoints cell;
    cell.setCount(positions.size());
    cell.radius = radius;
    for (std::size_t i = 0; i < cell.count; ++i) {
        cell.x[i] = positions[i][0], cell.y[i] = positions[i][1], cell.z[i] = positions[i][2];
        cell.nx[i] = normals[i][0], cell.ny[i] = normals[i][1], cell.nz[i] = normals[i][2];
        cell.confidence[i] = confidence;
        cell.weight[i] = confidence * bsplineWeight(1.5 * positions[i].norm() / radius);
    }
    cell.pad();
    return cell;
}

} // namespace mpuvdb::test
