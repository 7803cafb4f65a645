// Triangles about a frame.
#pragma once
#include <mpuvdb/vec.h>

#include <array>
#include <cstdint>
#include <vector>

namespace mpuvdb
{

/// An indexed triangle mesh about a frame: a vertex's world position is frame + position.
struct Mesh {
    using Triangle = std::array<std::uint32_t, 3>;

    Vec3d frame = Vec3d::Zero();
    std::vector<Vec3f> positions;    ///< world units, relative to frame
    std::vector<Triangle> triangles; ///< counter-clockwise seen from outside

    Vec3d world(std::size_t i) const { return frame + positions[i].cast<double>(); }
};

} // namespace mpuvdb
