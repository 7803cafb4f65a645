#include "surface_cells.h"

#include <algorithm>

namespace mpuvdb
{
namespace
{

/// Largest norm of the second derivatives, per voxel, and smallest of the gradient, beyond which a
/// cell holds a crease. [derived: radii of curvature of two voxels, the smallest that a band
/// resolves]
constexpr double kMaxBend = 0.5;

Vec3i corner(int bits)
{
    return {bits & 1, bits >> 1 & 1, bits >> 2 & 1};
}

} // namespace

bool isCrossed(const LeafWindow& window, const Vec3i& base)
{
    const bool inside = window(base) < 0;
    for (int n = 1; n < 8; ++n)
        if ((window(base + corner(n)) < 0) != inside) return true;
    return false;
}

CellTriangles::CellTriangles(const LeafWindow& window, const Vec3i& base) : mBase(base)
{
    for (int n = 0; n < 8; ++n) mValues[std::size_t(n)] = double(window(base + corner(n)));
    // Second and third corners of the six tetrahedra, which share the diagonal from corner 0 to 7
    // and split the faces of neighboring cells alike. [derived: the orders of the axes]
    constexpr int kFirst[6] = {1, 1, 2, 2, 4, 4}, kSecond[6] = {3, 5, 3, 6, 5, 6};
    for (int n = 0; n < 6; ++n) addTetrahedron({0, kFirst[n], kSecond[n], 7});
}

/// @param corners  in an order in which the bits of each are among those of the next.
void CellTriangles::addTetrahedron(const std::array<int, 4>& corners)
{
    std::array<int, 4> in, out;
    std::size_t ins = 0, outs = 0;
    for (const int c : corners) (mValues[std::size_t(c)] < 0 ? in[ins++] : out[outs++]) = c;
    if (ins == 0 || outs == 0) return;
    Vec3d outward = Vec3d::Zero();
    for (std::size_t n = 0; n < outs; ++n) outward += corner(out[n]).cast<double>() / double(outs);
    for (std::size_t n = 0; n < ins; ++n) outward -= corner(in[n]).cast<double>() / double(ins);
    if (ins == 2) {
        const SurfaceVertex a = vertex(in[0], out[0]), b = vertex(in[0], out[1]),
                            c = vertex(in[1], out[1]), d = vertex(in[1], out[0]);
        addTriangle({a, b, c}, outward);
        addTriangle({a, c, d}, outward);
        return;
    }
    std::array<SurfaceVertex, 3> found;
    for (std::size_t n = 0; n < 3; ++n)
        found[n] = ins == 1 ? vertex(in[0], out[n]) : vertex(in[n], out[0]);
    addTriangle(found, outward);
}

void CellTriangles::addTriangle(const std::array<SurfaceVertex, 3>& corners, const Vec3d& outward)
{
    SurfaceTriangle& t = mTriangles[std::size_t(mCount++)];
    t = corners;
    const Vec3d normal = (t[1].position - t[0].position).cross(t[2].position - t[0].position);
    if (normal.dot(outward) < 0) std::swap(t[1], t[2]);
}

SurfaceVertex CellTriangles::vertex(int a, int b) const
{
    const int low = std::min(a, b), high = std::max(a, b);
    const double u = mValues[std::size_t(low)], v = mValues[std::size_t(high)];
    SurfaceVertex found;
    found.from = mBase + corner(low);
    found.to = high ^ low;
    found.position = found.from.cast<double>() + u / (u - v) * corner(found.to).cast<double>();
    return found;
}

CellQuadric::CellQuadric(const LeafWindow& window, const Vec3i& base)
    : middle(base.cast<double>() + Vec3d::Constant(0.5))
{
    double f[2][2][2], sum = 0;
    bool known = true;
    for (int n = 0; n < 8; ++n) {
        const float v = window(base + corner(n));
        known &= window.isKnown(v);
        f[n & 1][n >> 1 & 1][n >> 2] = double(v);
        sum += double(v);
    }
    for (int axis = 0; axis < 3; ++axis) {
        const int u = (axis + 1) % 3, v = (axis + 2) % 3;
        double step = 0, twist = 0, second = 0;
        for (int n = 0; n < 8; ++n) {
            const Vec3i c = corner(n);
            const double here = f[c[0]][c[1]][c[2]];
            step += (c[axis] ? here : -here) / 4;
            twist += (c[u] == c[v] ? here : -here) / 2;
            const float beyond = window(base + c + (2 * c[axis] - 1) * Vec3i::Unit(axis));
            known &= window.isKnown(beyond);
            second += (double(beyond) - here) / 8;
        }
        gradient[axis] = step;
        bend(u, v) = bend(v, u) = twist;
        bend(axis, axis) = second;
    }
    value = (sum - bend.trace()) / 8;
    smooth = known && bend.norm() < kMaxBend && gradient.norm() > kMaxBend;
}

} // namespace mpuvdb
