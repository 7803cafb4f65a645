// Solids that fidelity is validated on: exact, and made by none of the library's code. Nothing in
// the library is chosen by looking at them, so that figures that are published can come from them.
#pragma once

#include <Eigen/Geometry>

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace validate
{

using Vec3 = Eigen::Vector3d;
using Box = Eigen::AlignedBox3d;

/// A closed surface, triangles counter-clockwise seen from outside.
struct Triangles {
    std::vector<Vec3> vertices; ///< world units
    std::vector<std::array<std::uint32_t, 3>> triangles;

    Vec3 corner(std::size_t triangle, std::size_t n) const
    {
        return vertices[triangles[triangle][n]];
    }
    /// As long as twice the area, outward.
    Vec3 cross(std::size_t triangle) const
    {
        const Vec3 a = corner(triangle, 0);
        return (corner(triangle, 1) - a).cross(corner(triangle, 2) - a);
    }
    Box bounds() const;
};

/// A solid whose surface is where a smooth function is zero.
class Implicit
{
public:
    virtual ~Implicit() = default;
    /// Negative inside; world units near the surface, or nearly so.
    virtual double value(const Vec3& p) const = 0;
    /// Whether value() is the distance wherever that is smooth.
    virtual bool isDistance() const { return false; }
    /// Holds the solid.
    virtual Box bounds() const = 0;

    /// If not known better, by differences of value(): exact to 1e-9 or so.
    virtual Vec3 gradient(const Vec3& p) const;
    /// The point of the surface that going along the gradient comes to, from a @a p near it.
    Vec3 project(const Vec3& p) const;
    /// The point of the surface that is nearest to @a p, for a @a p within a radius of curvature.
    Vec3 foot(const Vec3& p) const;
};

/// One solid: if it is smooth, a function and a mesh whose vertices lie on its surface; otherwise a
/// mesh that is exactly it.
struct Truth {
    std::shared_ptr<const Implicit> implicit; ///< null where the solid has edges
    Triangles mesh;
};

/// Names that makeImplicit() and makeTruth() know.
std::vector<std::string> solidNames();

/// The function alone; null where the solid has edges. @throws std::runtime_error for other names.
std::shared_ptr<const Implicit> makeImplicit(const std::string& name);

/// @param resolution  cells along the longest side of the grid that smooth solids are meshed on.
/// @throws std::runtime_error for names that are not among solidNames().
Truth makeTruth(const std::string& name, int resolution);

/// Triangles where @a solid is zero, one or two for each tetrahedron of a grid that the surface
/// passes; vertices are then put on the surface.
Triangles marchTetrahedra(const Implicit& solid, int resolution);

} // namespace validate
