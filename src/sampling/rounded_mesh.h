// Detects meshes whose positions were rounded to floats far from the origin.
#pragma once
#include <optional>
#include <string>

namespace mpuvdb
{

struct Mesh;

/// A warning, with the cure, about coordinates that are floats of 32 bits in steps that voxels of
/// @a voxelSize, world units, show: the mesh's faces are moved by up to half a step.
std::optional<std::string> roundingOf(const Mesh& mesh, double voxelSize);

} // namespace mpuvdb
