// Conversion between a grid's transform and a lattice of cubic voxels.
#pragma once
#include <mpuvdb/field.h>

#include <openvdb/Grid.h>
#include <openvdb/math/Transform.h>
#include <optional>
#include <string>

namespace mpuvdb
{

/// The lattice of @a transform; empty unless it is a positive uniform scale and a translation.
std::optional<Lattice> latticeOf(const openvdb::math::Transform& transform);

/// Why @a transform, which latticeOf() does not take, is none of a lattice.
std::string whyNoLattice(const openvdb::math::Transform& transform);

/// Give @a grid the transform of @a lattice.
void setLattice(openvdb::GridBase& grid, const Lattice& lattice);

/// @throws InputError unless the transform of @a grid is that of a lattice.
void requireUniformVoxels(const openvdb::GridBase& grid);

/// @throws UsageError unless @a voxelSize (world units) is positive and finite, LimitError below
/// 1.5e-5, whose transforms OpenVDB takes for singular, and above 1e18, where floats overflow.
void requireVoxelSize(double voxelSize);

} // namespace mpuvdb
