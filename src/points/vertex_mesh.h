// The mesh whose vertices points are, in numbers.
#pragma once
#include <mpuvdb/point_cloud.h>

#include <array>
#include <memory>

namespace mpuvdb
{

/// The numbers of a mesh, in time proportional to its size. Corners at the same position are one.
/// @param positions  world units; those of corners are finite. @return null for a mesh without
/// area.
std::shared_ptr<const VertexMesh>
vertexMesh(const std::vector<Vec3d>& positions,
           const std::vector<std::array<std::uint32_t, 3>>& triangles);

} // namespace mpuvdb
