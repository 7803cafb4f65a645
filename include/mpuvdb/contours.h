// Plane cuts of level sets: closed contours, for printers and pages.
#pragma once
#include <mpuvdb/level_set.h>

#include <Eigen/Core>

#include <filesystem>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// A plane across an axis. Its two axes follow that one in the order x, y, z, x: seen against the
/// axis, the second lies counter-clockwise from the first.
struct SlicePlane {
    int axis = 2;      ///< 0: x, 1: y, 2: z
    double height = 0; ///< world units

    int firstAxis() const { return (axis + 1) % 3; }
    int secondAxis() const { return (axis + 2) % 3; }
};

/// A closed line in the plane, world units. The solid lies to its left: outer contours run
/// counter-clockwise, those of holes clockwise.
struct Contour {
    std::vector<Eigen::Vector2d> points; ///< the last one is joined to the first
    double area = 0;                     ///< that it encloses, world units squared; < 0 for a hole
};

/// The contours at a height, world units.
struct Slice {
    double height = 0;
    std::vector<Contour> contours;
};

/// The contours of the solid at each of @a heights across @a axis (0: x, 1: y, 2: z): those of its
/// mesh, extractMesh(), so that edges and corners are as sharp. A point lies within a hundredth of
/// a voxel and h^2 / (4 r) of a surface of radius r, h the voxel size. Slices are taken a
/// thousandth of a voxel below: where the surface lies in a plane, it is the solid below it that is
/// cut. The same for any number of threads.
/// @param heights  world units, finite, in any order; slices have the same.
/// @throws UsageError for settings out of range, LimitError (see extractMesh()), Interrupted.
std::vector<Slice> slicesOf(const LevelSet& levelSet, int axis, const std::vector<double>& heights,
                            Interrupter* interrupter = nullptr);

/// Writes slices across one axis as SVG in millimeters, a group for each with its height in
/// millimeters ("data-height"). The second axis of the plane points up. The page is @a bounds, with
/// a margin of a hundredth.
/// @param bounds  of the solid, world units. @param metersPerUnit  above 0.
/// @throws UsageError (settings out of range), IoError, Interrupted.
void writeContours(const std::filesystem::path& file, const std::vector<Slice>& slices, int axis,
                   const Box3d& bounds, double metersPerUnit, Interrupter* interrupter = nullptr);

} // namespace mpuvdb
