// Points as data at the nodes of a grid: their signed distance at nodes close to them.
#pragma once
#include "mpu/octree/sorted_points.h"
#include "tension_spline.h"

#include <functional>
#include <vector>

namespace mpuvdb
{

/// A grid of nodes in space.
struct Nodes {
    NodeGrid grid;
    Vec3d corner;    ///< the first node, local coordinates
    double step = 1; ///< distance between nodes, world units

    Vec3d at(int i, int j, int k) const { return corner + step * Vec3d(i, j, k); }
};

/// Data at the nodes near them.
struct NodeData {
    explicit NodeData(const NodeGrid& grid) : weight(grid.size(), 0.0f), distance(grid.size(), 0.0f)
    {
    }

    std::vector<float> weight;   ///< 0 where there are none
    std::vector<float> distance; ///< signed, node steps
};

/// The points of a small cube merged into one: mean position, weighted sum of normals.
struct Dipole {
    Vec3f position, normal;
    float weight;
};

/// The points of an octree's cubes as dipoles.
class DipoleSource
{
public:
    DipoleSource(const SortedPoints& points, const RootCube& root) : mPoints(points), mRoot(root) {}

    /// Of all cubes no larger than @a size, in Morton order.
    std::vector<Dipole> all(double size) const;
    /// Of those, the dipoles that reach a node. They and their order depend on no point farther
    /// away than a kernel's radius and a cube.
    std::vector<Dipole> near(const Nodes& nodes, double size) const;
    /// Whether f(point) holds for any in @a box of one point for each cube no larger than @a size.
    bool isAny(const Box3d& box, double size, const std::function<bool(const Vec3d&)>& f) const;
    /// Mean distance between points, by the area of the occupied cells of a level with a few points
    /// per cell; a plane meets a cube in 2/3 of its face on average.
    double meanSpacing() const;

private:
    /// Add the dipoles of the cubes whose first point is in @a among.
    void add(int level, const SortedPoints::Range& among, std::vector<Dipole>& dipoles) const;

    const SortedPoints& mPoints;
    const RootCube& mRoot;
};

/// Largest cubes whose points are merged into a dipole for nodes a @a step apart.
double dipoleSize(double step);

/// Data at the interior nodes close to points.
/// @param noise  standard deviation of the points, world units.
NodeData splat(const std::vector<Dipole>& dipoles, const Nodes& nodes, double noise,
               Interrupter& progress);

} // namespace mpuvdb
