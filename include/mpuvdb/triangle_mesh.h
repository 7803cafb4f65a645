// Indexed triangle meshes.
#pragma once
#include <mpuvdb/attributes.h>
#include <mpuvdb/vec.h>

#include <array>
#include <cstdint>
#include <vector>

namespace mpuvdb
{

/// An indexed triangle mesh; a vertex's world position is frame + position. Attributes are empty or
/// one per vertex.
struct Mesh {
    using Triangle = std::array<std::uint32_t, 3>;

    Vec3d frame = Vec3d::Zero();
    std::vector<Vec3f> positions;      ///< world units, relative to frame
    std::vector<Triangle> triangles;   ///< counter-clockwise seen from outside
    std::vector<Vec3f> colors;         ///< linear red, green and blue, in [0,1]
    std::vector<NamedScalars> scalars; ///< names differ

    /// World position of vertex @a i.
    Vec3d world(std::size_t i) const { return frame + positions[i].cast<double>(); }
    /// Call f(values), a vector with one value per vertex, for each attribute.
    template <class F>
    void forEachAttribute(const F& f)
    {
        if (!colors.empty()) f(colors);
        for (NamedScalars& s : scalars) f(s.values);
    }
};

} // namespace mpuvdb
