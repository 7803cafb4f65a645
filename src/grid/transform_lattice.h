// What a grid's transform has to be for its voxels to form a lattice.
#pragma once
#include <mpuvdb/field.h>

#include <openvdb/Grid.h>
#include <openvdb/math/Transform.h>

#include <optional>

namespace mpuvdb
{

/// The lattice of @a transform; empty unless it only scales, by one positive number, and
/// translates.
std::optional<Lattice> latticeOf(const openvdb::math::Transform& transform);

/// Give @a grid the transform of @a lattice.
void setLattice(openvdb::GridBase& grid, const Lattice& lattice);

/// @throws InputError unless its transform is that of a lattice.
void demandUniformVoxels(const openvdb::GridBase& grid);

/// @throws UsageError unless @a voxelSize is a positive number, LimitError for one that is too
/// small for a transform: OpenVDB takes those whose determinant is below 3e-15 for singular.
void demandVoxelSize(double voxelSize);

} // namespace mpuvdb
