// How Python's shapes are sampled.
#pragma once
#include "arguments.h"

#include <mpuvdb/shape.h>

#include <cstdint>
#include <optional>

namespace mpuvdb::python
{

#define MPUVDB_SAMPLING_DOC                                                                        \
    " voxel_size: world units, or '1%' of the diagonal of the bounds; None: that of the finest "   \
    "level set it is made of, where that makes at most 64 times the voxels of all (else a "        \
    "LimitError names one that does). half_width: voxels, in "                                     \
    "[1.5, 1000]. max_bytes: memory that all grids together may take, 0 for any; None: "           \
    "nine tenths of the machine's, or of the control group's. More is a LimitError before it is "  \
    "taken. A level set without any voxels is a UserWarning."

using VoxelSize = std::optional<LengthArgument>;
using MaxBytes = std::optional<std::uint64_t>;

ShapeSettings settingsFor(const Shape& shape, const VoxelSize& voxelSize, double halfWidth,
                          const MaxBytes& maxBytes);

/// To evaluate @a shape: the finest grid's voxels are not taken where that multiplies the others'.
ShapeSettings settingsToWork(const Shape& shape, const VoxelSize& voxelSize, double halfWidth,
                             const MaxBytes& maxBytes);

/// As Shape::evaluate(), with a note where nothing is left.
LevelSet evaluated(const Shape& shape, const ShapeSettings& settings, Interrupter& progress);

} // namespace mpuvdb::python
