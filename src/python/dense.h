// Level sets as dense arrays.
#pragma once
#include <mpuvdb/interrupter.h>
#include <mpuvdb/operations.h>

#include <pybind11/numpy.h>

namespace mpuvdb::python
{

/// (values, origin): the smallest block that holds all active voxels, and the world position of its
/// voxel [0, 0, 0]. Voxels beyond the band have the background's magnitude.
pybind11::tuple denseOf(const LevelSet& levelSet);

/// What denseOf() took apart. Needs no lock of the interpreter.
/// @throws UsageError (shape, sizes), InputError (not finite, the solid meets the array's border),
/// Interrupted.
LevelSet levelSetOf(const pybind11::array_t<float>& values, const Vec3d& origin, double voxelSize,
                    double halfWidth, const Interrupter& progress);

/// A block of any values as a grid, whose background is the one of them that is farthest outside.
/// Needs no lock of the interpreter.
/// @throws UsageError (shape, sizes), InputError (not finite, inside at the array's border),
/// Interrupted.
openvdb::FloatGrid::Ptr gridOf(const pybind11::array_t<float>& values, const Vec3d& origin,
                               double voxelSize, double value, Inside inside,
                               const Interrupter& progress);

} // namespace mpuvdb::python
