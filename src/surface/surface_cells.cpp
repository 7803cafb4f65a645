#include "surface_cells.h"

#include "cell_sheets.h"

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

/// Newton steps from a place @a p in the cell at @a base to where the values, trilinear between
/// voxels, are zero; within the cell.
Vec3d ontoZero(const LeafWindow& window, const Vec3i& base, Vec3d p)
{
    // The number of steps. [derived: where a box's edge lies on voxels the zero is a double one,
    // and each step leaves half of the way]
    constexpr int kSteps = 3;
    for (int step = 0; step < kSteps; ++step) {
        double value = 0;
        Vec3d gradient = Vec3d::Zero();
        for (int n = 0; n < 8; ++n) {
            const Vec3i c = corner(n);
            const double here = double(window(base + c));
            const Vec3d share =
                c.cast<double>().cwiseProduct(2 * p - Vec3d::Ones()) + Vec3d::Ones() - p;
            value += here * share.prod();
            for (int axis = 0; axis < 3; ++axis) {
                const double others = share[(axis + 1) % 3] * share[(axis + 2) % 3];
                gradient[axis] += here * (c[axis] ? others : -others);
            }
        }
        const double square = gradient.squaredNorm();
        if (!(square > 0)) break;
        p = (p - value / square * gradient).cwiseMax(0).cwiseMin(1);
    }
    return p;
}

/// The vertex on an edge of the cell at @a base.
SurfaceVertex vertexOn(const LeafWindow& window, const Vec3i& base, int edge)
{
    const int low = cellEdge(edge).low;
    SurfaceVertex found;
    found.from = base + Vec3i(low >> 2 & 1, low >> 1 & 1, low & 1);
    found.axis = edge / 4;
    const double u = double(window(found.from)),
                 v = double(window(found.from + Vec3i::Unit(found.axis)));
    found.position = found.from.cast<double>();
    found.position[found.axis] += u / (u - v);
    return found;
}

} // namespace

bool isCrossed(const LeafWindow& window, const Vec3i& base)
{
    const bool inside = window(base) < 0;
    for (int n = 1; n < 8; ++n)
        if ((window(base + corner(n)) < 0) != inside) return true;
    return false;
}

CellTriangles::CellTriangles(const LeafWindow& window, const Vec3i& base, const JoinedFaces& faces,
                             const openvdb::Coord& at)
{
    std::uint8_t inside = 0;
    for (int c = 0; c < 8; ++c) // x is the highest bit of a cell's corners, the lowest of corner()
        if (window(base + corner((c & 1) << 2 | (c & 2) | c >> 2)) < 0)
            inside = std::uint8_t(inside | 1 << c);
    const std::uint8_t joined = ambiguousFaces(inside) ? faces.of(at, inside) : std::uint8_t(0);
    const CellSheets& sheets = cellSheets(inside, joined);
    mSheets = sheets.count;
    std::array<SurfaceVertex, 12> vertices;
    std::array<Vec3d, 4> middles;
    for (std::size_t s = 0; s < sheets.count; ++s) {
        Vec3d sum = Vec3d::Zero();
        int count = 0;
        for (unsigned edges = sheets.edges[s]; edges; edges &= edges - 1) {
            const int e = __builtin_ctz(edges);
            vertices[std::size_t(e)] = vertexOn(window, base, e);
            sum += vertices[std::size_t(e)].position;
            ++count;
        }
        middles[s] = sum / double(count);
        // Of several sheets none is the values' zero alone.
        if (sheets.count == 1)
            middles[s] =
                base.cast<double>() + ontoZero(window, base, middles[s] - base.cast<double>());
    }
    for (std::size_t face = 0; face < 6; ++face) {
        const FaceSegments across = faceSegments(face, inside, (joined >> face & 1) != 0);
        for (std::size_t n = 0; n < across.count; ++n) {
            const auto from = std::size_t(across.edges[n][0]), to = std::size_t(across.edges[n][1]);
            mTriangles[std::size_t(mCount++)] = {middles[sheets.sheet[from]], vertices[from],
                                                 vertices[to]};
        }
    }
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
