// A face that the sheets of both its cells pass twice is decided the other way. As sheets are
// oriented, that splits either sheet, so it makes no other face such a one. Faces are decided one
// after the other, in steps: across one axis, at the even or odd voxels of it, no two of a step
// belong to one cell. So the result is that of a few cells' values, and of no order of work.
#include "joined_faces.h"

#include "cell_sheets.h"
#include "octant_plane.h"

namespace mpuvdb
{
namespace
{

using openvdb::Coord;

/// Steps in which faces are decided. [derived: even and odd ones across three axes]
constexpr int kSteps = 6;

/// The step in which the lower face across @a axis of the cell at @a at is decided.
int stepOf(const Coord& at, int axis)
{
    return 2 * axis + (at[axis] & 1);
}

/// The cell whose lower face is face @a face of the cell at @a at.
Coord above(Coord at, int face)
{
    at[face / 2] += face % 2;
    return at;
}

} // namespace

std::uint8_t JoinedFaces::of(const Coord& at, std::uint8_t inside) const
{
    return inStep(at, inside, kSteps);
}

/// The joined faces before a step.
std::uint8_t JoinedFaces::inStep(const Coord& at, std::uint8_t inside, int step) const
{
    std::uint8_t joined = byValues(at, inside);
    const std::uint8_t ambiguous = ambiguousFaces(inside);
    // A face that the cell's sheets do not pass twice by the values alone never changes.
    const CellSheets& sheets = cellSheets(inside, joined);
    for (int face = 0; face < 6; ++face) {
        if (!(ambiguous >> face & 1) || !passesTwice(sheets, face)) continue;
        const Coord low = above(at, face);
        if (stepOf(low, face / 2) < step && changes(low, face / 2))
            joined = std::uint8_t(joined ^ 1 << face);
    }
    return joined;
}

/// Whether the lower face across @a axis of the cell at @a at is decided against its values.
bool JoinedFaces::changes(const Coord& at, int axis) const
{
    const int step = stepOf(at, axis);
    Coord below = at;
    --below[axis];
    for (const auto& [cell, face] : {std::pair(at, 2 * axis), std::pair(below, 2 * axis + 1)}) {
        const std::uint8_t inside = cornersAt(cell);
        if (!passesTwice(cellSheets(inside, inStep(cell, inside, step)), face)) return false;
    }
    return true;
}

/// The ambiguous faces whose middle is inside.
std::uint8_t JoinedFaces::byValues(const Coord& at, std::uint8_t inside) const
{
    std::uint8_t joined = 0;
    const std::uint8_t ambiguous = ambiguousFaces(inside);
    for (int face = 0; face < 6; ++face) {
        if (!(ambiguous >> face & 1)) continue;
        const Coord low = above(at, face);
        Coord u(0), v(0);
        u[(face / 2 + 1) % 3] = 1;
        v[(face / 2 + 2) % 3] = 1;
        const float middle = towards(low, u + v) + towards(low + u, v - u) +
                             towards(low + u + v, Coord(0) - u - v) + towards(low + v, u - v);
        if (middle < 0) joined = std::uint8_t(joined | 1 << face);
    }
    return joined;
}

/// The value, voxels, half a step from @a corner, by its plane as far as that is trusted.
float JoinedFaces::towards(const Coord& corner, const Coord& step) const
{
    const OctantPlane plane = octantPlaneAt(mAccess, corner, mPerVoxel);
    const Vec3f half = 0.5f * Vec3f(float(step.x()), float(step.y()), float(step.z()));
    return plane.distance + plane.weight() * plane.steepness * plane.normal.dot(half);
}

std::uint8_t JoinedFaces::cornersAt(const Coord& at) const
{
    return cornersInside(
        [&](int x, int y, int z) { return mAccess.getValue(at.offsetBy(x, y, z)); });
}

} // namespace mpuvdb
