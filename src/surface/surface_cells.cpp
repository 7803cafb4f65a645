#include "surface_cells.h"

#include "quadratic_error.h"

#include <algorithm>
#include <optional>

namespace mpuvdb
{
namespace
{

/// Largest norm of the second derivatives, per voxel, and smallest of the gradient, beyond which
/// values are of several faces. [derived: radii of curvature of two voxels, the smallest that a
/// band resolves]
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

/// The plane through a crossing.
struct EdgePlane {
    Vec3d point = Vec3d::Zero();
    Vec3d normal = Vec3d::Zero(); ///< unit
    double weight = 0;            ///< 0: there is none
};

/// Where the surface crosses an edge of a cell.
struct EdgeCrossing {
    SurfaceVertex vertex;
    std::optional<EdgePlane> plane; ///< where the values along the edge's line are of several faces
};

/// The plane at one of the ends of the edge from a voxel along an axis.
EdgePlane planeThrough(const LeafWindow& window, const Vec3i& from, int axis)
{
    const Vec3i along = Vec3i::Unit(axis);
    const OctantPlane low = window.planeAt(from), high = window.planeAt(from + along);
    const bool rises = window(from) < 0;
    const PlaneCrossing crossing = crossingByPlanes(rises ? low : high, rises ? high : low,
                                                    (rises ? 1.0f : -1.0f) * along.cast<float>());
    if (!crossing.plane) return {};
    const double at = double(rises ? crossing.at : 1 - crossing.at);
    return {from.cast<double>() + at * along.cast<double>(), crossing.plane->normal.cast<double>(),
            double(crossing.plane->weight())};
}

/// The crossing of the edge from a voxel along an axis: linear between the two values, or, where
/// they are of several faces, on the plane through it.
EdgeCrossing crossingOn(const LeafWindow& window, const Vec3i& from, int axis)
{
    const Vec3i along = Vec3i::Unit(axis);
    const double u = double(window(from)), v = double(window(from + along));
    const double below = double(window(from - along)) - 2 * u + v,
                 above = u - 2 * v + double(window(from + 2 * along));
    EdgeCrossing found{{from, axis, from.cast<double>()}, {}};
    double at = u / (u - v);
    if (std::max(std::abs(below), std::abs(above)) > kMaxBend) {
        found.plane = planeThrough(window, from, axis);
        const double onPlane = std::min(std::max(found.plane->point[axis] - from[axis], 0.0), 1.0);
        at += found.plane->weight * (onPlane - at);
    }
    found.vertex.position[axis] += at;
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

struct CellFans::Crossings {
    std::array<EdgeCrossing, 12> on; ///< by edge
};

/// The middle of a sheet's vertices, on the surface: where the values are zero, and on a crease
/// where its planes meet.
Vec3d CellFans::middleOf(const LeafWindow& window, const Vec3i& base, const Crossings& crossings,
                         const CellSheets& sheets, std::size_t sheet)
{
    Vec3d mean = Vec3d::Zero();
    int count = 0;
    bool bends = false;
    for (unsigned edges = sheets.edges[sheet]; edges; edges &= edges - 1) {
        const EdgeCrossing& crossing = crossings.on[std::size_t(__builtin_ctz(edges))];
        mean += crossing.vertex.position;
        ++count;
        bends = bends || crossing.plane;
    }
    const Vec3d corner = base.cast<double>();
    mean = mean / count - corner;
    // Of several sheets none is the values' zero alone.
    const Vec3d smooth = sheets.count == 1 ? ontoZero(window, base, mean) : mean;
    if (!bends) return corner + smooth;
    QuadraticError quadric(mean);
    double weights = 0;
    for (unsigned edges = sheets.edges[sheet]; edges; edges &= edges - 1) {
        const EdgeCrossing& crossing = crossings.on[std::size_t(__builtin_ctz(edges))];
        const SurfaceVertex& vertex = crossing.vertex;
        const EdgePlane plane =
            crossing.plane ? *crossing.plane : planeThrough(window, vertex.from, vertex.axis);
        quadric.add(plane.normal, plane.point - corner, plane.weight);
        weights += plane.weight;
    }
    // Of a surface that curves as strongly as this planes have little weight.
    const Vec3d sharp = quadric.minimum(0, kMinEigenvalue).place;
    return corner + smooth + weights / count * (sharp - smooth);
}

CellFans::CellFans(const LeafWindow& window, const Vec3i& base, const JoinedFaces& faces,
                   const openvdb::Coord& at)
{
    const std::uint8_t inside =
        cornersInside([&](int x, int y, int z) { return window(base + Vec3i(x, y, z)); });
    const std::uint8_t joined = ambiguousFaces(inside) ? faces.of(at, inside) : std::uint8_t(0);
    const CellSheets& sheets = cellSheets(inside, joined);
    mSheets = sheets.count;
    Crossings crossings;
    std::array<Vec3d, 4> middles;
    for (std::size_t s = 0; s < sheets.count; ++s) {
        for (unsigned edges = sheets.edges[s]; edges; edges &= edges - 1) {
            const int e = __builtin_ctz(edges);
            const int low = cellEdge(e).low;
            crossings.on[std::size_t(e)] =
                crossingOn(window, base + Vec3i(low >> 2 & 1, low >> 1 & 1, low & 1), e / 4);
        }
        middles[s] = middleOf(window, base, crossings, sheets, s);
    }
    for (std::size_t face = 0; face < 6; ++face) {
        const FaceSegments across = faceSegments(face, inside, (joined >> face & 1) != 0);
        for (std::size_t n = 0; n < across.count; ++n) {
            const auto from = std::size_t(across.edges[n][0]), to = std::size_t(across.edges[n][1]);
            mTriangles[std::size_t(mCount++)] = {
                middles[sheets.sheet[from]], crossings.on[from].vertex, crossings.on[to].vertex};
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
