// The mesh whose vertices points are, in numbers.
#pragma once
#include <mpuvdb/point_cloud.h>

#include <array>
#include <memory>

namespace mpuvdb
{

/// The numbers of a mesh in one pass over its triangles. Corners at the same position are the same.
/// @param positions  world units, finite. @return null for a mesh without area.
std::shared_ptr<const VertexMesh>
vertexMesh(const std::vector<Vec3d>& positions,
           const std::vector<std::array<std::uint32_t, 3>>& triangles);

} // namespace mpuvdb
