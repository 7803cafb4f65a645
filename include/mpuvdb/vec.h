// Vectors and boxes of the public interface.
#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>

namespace mpuvdb
{

using Vec3f = Eigen::Vector3f;
using Vec3d = Eigen::Vector3d;
using Vec3i = Eigen::Vector3i;
/// Axis-aligned box; empty when default-constructed.
using Box3d = Eigen::AlignedBox3d;

/// The axis of the world that points up.
enum class UpAxis { Y, Z };

} // namespace mpuvdb
