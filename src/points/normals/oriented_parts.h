// The connected parts of a surface that points lie on, and which side of each is its outside.
#pragma once
#include <mpuvdb/vec.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace mpuvdb
{

/// Oriented points of parts that hang together.
struct OrientedParts {
    const std::vector<Vec3f>& positions;
    const std::vector<Vec3f>& normals;
    const std::vector<std::uint32_t>& parts; ///< of each point
};

/// The points of a part and the box about them.
struct Part {
    std::vector<std::uint32_t> points;
    Eigen::AlignedBox3f box;
};

/// The box about some of the points.
Eigen::AlignedBox3f boxOf(const std::vector<std::uint32_t>& some, const OrientedParts& points);

/// One more than the last part.
std::size_t partEnd(const OrientedParts& points);

/// The parts, in the order of their first points.
std::vector<Part> collectParts(const OrientedParts& points);

/// What is seen of a part from six sides, along the axes.
struct Visibility {
    double facing = 0; ///< how much of it faces the viewers: from -1, where all looks inward, to 1
    /// Share that shows the other side than the rest, and not in single pixels: the inner side of
    /// a solid, through its openings.
    double through = 0;
};

/// @param perPixel  mean number of points in a pixel: the more, the less one sees between points
/// that lie unevenly, and of small openings.
Visibility visibilityOf(const Part& part, const OrientedParts& points, double perPixel);

/// Calls f(position, normal) for a few points of a part.
template <class F>
void forAFew(const Part& part, const OrientedParts& points, F&& f)
{
    constexpr std::size_t kAsked = 64; // [derived: a share is known to a sixteenth]
    const std::size_t asked = std::min(kAsked, part.points.size());
    for (std::size_t k = 0; k < asked; ++k) {
        const std::uint32_t i = part.points[k * part.points.size() / asked];
        f(points.positions[i].cast<double>(), points.normals[i].cast<double>());
    }
}

/// Points of a part for a square of the box about them where a grid gathers them. [derived: a cell
/// of a ball has ten then, so that none is missed]
constexpr double kPointsPerCell = 32;

/// A part's surface as one dipole for each cell of a coarse grid: its winding number [Barill18].
class PartWinding
{
public:
    PartWinding(const Part& part, const OrientedParts& points, bool turned);

    /// About 1 or -1 within a closed part, 0 without.
    double at(const Vec3d& p) const;
    /// The same at a few points of a part.
    std::vector<double> on(const Part& part, const OrientedParts& points) const;

    double cell() const { return mCell; } ///< its side
    double area() const { return mArea; } ///< of the surface

private:
    struct Dipole {
        Vec3d position = Vec3d::Zero(), normal = Vec3d::Zero();
        double points = 0;
    };
    std::vector<Dipole> mDipoles;
    double mSoftening = 0, mCell = 0, mArea = 0;
};

/// Whether most of a few points of @a inner lie within the closed part that @a outer is.
bool liesWithin(const Part& inner, const PartWinding& outer, const OrientedParts& points);

} // namespace mpuvdb
