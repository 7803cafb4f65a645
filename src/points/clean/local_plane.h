// The plane of a few positions.
#pragma once
#include <mpuvdb/vec.h>

#include <cstdint>
#include <vector>

namespace mpuvdb
{

/// Least-squares plane: its middle, unit normal, and the variances of the positions along the
/// normal and along the two axes within the plane, ascending.
struct LocalPlane {
    Vec3d middle = Vec3d::Zero();
    Vec3d normal = Vec3d::UnitZ();
    Vec3d variances = Vec3d::Zero();

    double height(const Vec3f& p) const { return normal.dot(p.cast<double>() - middle); }
    /// Whether there is a plane at all: at the rim of a thin wall there is none.
    bool isThin() const { return variances[0] < 0.15 * variances[1]; }
};

/// The plane of positions[members]; of less than two distinct ones any normal.
LocalPlane planeOf(const std::vector<Vec3f>& positions, const std::vector<std::uint32_t>& members);

/// Whether a position lies with its neighbors on a plane. @param reach  the distance of the
/// farthest.
bool liesFlat(const std::vector<Vec3f>& positions, std::size_t point,
              const std::vector<std::uint32_t>& neighbors, double reach);

/// The plane of those members that lie on the first one's sheet, where the rest lie on another:
/// beyond an edge, or on the other side of a thin wall. It holds more than half of them and is
/// much thinner than @a whole, the plane of all; else @a whole.
/// @param members  nearest to the first one first.
/// @param noise    standard deviation of the positions; planes that it can make are left as they
/// are.
LocalPlane sheetPlaneOf(const std::vector<Vec3f>& positions,
                        const std::vector<std::uint32_t>& members, const LocalPlane& whole,
                        double noise);

} // namespace mpuvdb
