// Interpolation in grids with values in a band only.
#pragma once
#include <openvdb/openvdb.h>

#include <cmath>
#include <type_traits>

namespace mpuvdb
{

/// The trilinear mean of the active ones of the eight voxels about @a at (index space); 0 without
/// any.
template <class Accessor>
typename Accessor::ValueType activeValue(const Accessor& grid, const openvdb::Vec3d& at)
{
    using Value = typename Accessor::ValueType;
    using Sum = std::conditional_t<std::is_arithmetic_v<Value>, double, openvdb::Vec3d>;
    const openvdb::Coord base = openvdb::Coord::floor(at);
    Sum sum = openvdb::zeroVal<Sum>();
    double weight = 0;
    for (int corner = 0; corner < 8; ++corner) {
        const openvdb::Coord voxel =
            base + openvdb::Coord(corner & 1, corner >> 1 & 1, corner >> 2 & 1);
        Value value = openvdb::zeroVal<Value>();
        if (!grid.probeValue(voxel, value)) continue;
        double w = 1;
        for (int k = 0; k < 3; ++k) w *= 1 - std::abs(at[k] - voxel[k]);
        sum += w * Sum(value);
        weight += w;
    }
    return weight > 0 ? Value(sum / weight) : openvdb::zeroVal<Value>();
}

} // namespace mpuvdb
