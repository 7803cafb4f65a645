#include "cut_mesh.h"
#include <mpuvdb/contours.h>
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

namespace mpuvdb
{
namespace
{

/// How far below its height a plane is, voxels: vertices of a face in it differ by roundings.
/// [derived: a tenth of what a contour may be off]
constexpr double kBelow = 1e-3;

/// An edge of the mesh: its lower vertex in the upper half.
using Edge = std::uint64_t;

Edge edgeOf(std::uint32_t v, std::uint32_t w)
{
    return Edge(std::min(v, w)) << 32 | std::max(v, w);
}

/// The part of a contour in a triangle, from the crossing of one edge to that of another.
struct Segment {
    Edge from, to;
};

/// Planes across an axis of a mesh, and the triangles that they cross.
class Planes
{
public:
    /// @param mesh  closed; outlives this. @param heights  ascending, world units.
    Planes(const Mesh& mesh, int axis, std::vector<double> heights, const Interrupter& progress)
        : mMesh(mesh), mPlane{axis, 0}, mHeights(std::move(heights)), mProgress(progress),
          mFirst(mHeights.size() + 1, 0)
    {
        forEachCrossing([&](std::size_t n, std::uint32_t) { ++mFirst[n + 1]; });
        std::partial_sum(mFirst.begin(), mFirst.end(), mFirst.begin());
        mTriangles.resize(mFirst.back());
        std::vector<std::size_t> next(mFirst.begin(), mFirst.end() - 1);
        forEachCrossing([&](std::size_t n, std::uint32_t t) { mTriangles[next[n]++] = t; });
    }

    std::vector<Contour> contours(std::size_t n) const { return joined(n, segments(n)); }

private:
    double heightOf(std::uint32_t v) const
    {
        return mMesh.frame[mPlane.axis] + double(mMesh.positions[v][mPlane.axis]);
    }

    /// Calls visit(n, triangle) for each triangle with a vertex below plane n, and one that is not:
    /// a vertex on a plane counts as above it, so that each plane has closed contours.
    template <typename Visit>
    void forEachCrossing(const Visit& visit) const
    {
        for (std::size_t t = 0; t < mMesh.triangles.size(); ++t) {
            if (t % kCheckStride == 0) mProgress.check();
            const auto& [a, b, c] = mMesh.triangles[t];
            const auto [low, high] = std::minmax({heightOf(a), heightOf(b), heightOf(c)});
            auto plane = std::upper_bound(mHeights.begin(), mHeights.end(), low);
            for (; plane != mHeights.end() && *plane <= high; ++plane)
                visit(std::size_t(plane - mHeights.begin()), std::uint32_t(t));
        }
    }

    /// The segments on plane @a n, sorted by their first edges. The solid lies to their left.
    std::vector<Segment> segments(std::size_t n) const
    {
        std::vector<Segment> segments;
        for (std::size_t i = mFirst[n]; i < mFirst[n + 1]; ++i) {
            const Mesh::Triangle& t = mMesh.triangles[mTriangles[i]];
            std::array<bool, 3> isAbove{};
            for (std::size_t c = 0; c < 3; ++c) isAbove[c] = heightOf(t[c]) >= mHeights[n];
            Segment segment{};
            for (std::size_t c = 0; c < 3; ++c) {
                const std::size_t d = (c + 1) % 3;
                if (isAbove[c] == isAbove[d]) continue;
                (isAbove[c] ? segment.from : segment.to) = edgeOf(t[c], t[d]);
            }
            segments.push_back(segment);
        }
        std::sort(segments.begin(), segments.end(),
                  [](const Segment& a, const Segment& b) { return a.from < b.from; });
        return segments;
    }

    /// Where @a edge crosses plane @a n.
    Eigen::Vector2d crossing(Edge edge, std::size_t n) const
    {
        const auto v = std::uint32_t(edge >> 32), w = std::uint32_t(edge);
        const double from = heightOf(v), to = heightOf(w);
        const Vec3d p =
            mMesh.world(v) + (mHeights[n] - from) / (to - from) * (mMesh.world(w) - mMesh.world(v));
        return {p[mPlane.firstAxis()], p[mPlane.secondAxis()]};
    }

    std::vector<Contour> joined(std::size_t n, const std::vector<Segment>& segments) const;

    const Mesh& mMesh;
    SlicePlane mPlane;
    std::vector<double> mHeights;
    const Interrupter& mProgress;
    std::vector<std::size_t> mFirst;       ///< of each plane in mTriangles, and their number
    std::vector<std::uint32_t> mTriangles; ///< that cross each plane, ascending
};

double areaOf(const std::vector<Eigen::Vector2d>& points)
{
    double twice = 0;
    const Eigen::Vector2d& origin = points.front(); // for precision far from the world's
    for (std::size_t n = 0; n < points.size(); ++n) {
        const Eigen::Vector2d a = points[n] - origin, b = points[(n + 1) % points.size()] - origin;
        twice += a.x() * b.y() - a.y() * b.x();
    }
    return twice / 2;
}

/// Joins segments, sorted by their first edges, to contours: in a closed mesh, a segment begins
/// where another one ends.
std::vector<Contour> Planes::joined(std::size_t n, const std::vector<Segment>& segments) const
{
    std::vector<Contour> contours;
    std::vector<bool> isUsed(segments.size());
    for (std::size_t first = 0; first < segments.size(); ++first) {
        Contour contour;
        for (std::size_t at = first; !isUsed[at];) {
            isUsed[at] = true;
            const Eigen::Vector2d point = crossing(segments[at].from, n);
            if (contour.points.empty() || contour.points.back() != point)
                contour.points.push_back(point);
            const auto next =
                std::lower_bound(segments.begin(), segments.end(), segments[at].to,
                                 [](const Segment& s, Edge edge) { return s.from < edge; });
            at = std::size_t(next - segments.begin());
        }
        while (contour.points.size() > 1 && contour.points.back() == contour.points.front())
            contour.points.pop_back();
        if (contour.points.size() < 3) continue; // it touches the plane in a point
        contour.area = areaOf(contour.points);
        contours.push_back(std::move(contour));
    }
    return contours;
}

} // namespace

std::vector<Slice> slicesOf(const LevelSet& levelSet, int axis, const std::vector<double>& heights,
                            Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    if (axis < 0 || axis > 2)
        throw UsageError(fmt::format("slice: axis is {}, and must be 0, 1 or 2", axis));
    for (const double height : heights)
        if (!std::isfinite(height))
            throw UsageError(fmt::format("slice: a height is {}, and must be finite", height));
    const Mesh mesh = extractMesh(levelSet, {}, &progress);
    std::vector<std::size_t> order(heights.size());
    std::iota(order.begin(), order.end(), std::size_t(0));
    std::sort(order.begin(), order.end(),
              [&](std::size_t a, std::size_t b) { return heights[a] < heights[b]; });
    std::vector<double> ascending;
    for (const std::size_t n : order)
        ascending.push_back(heights[n] - kBelow * levelSet.voxelSize());
    progress.beginStage("slice", double(heights.size()));
    const Planes planes(mesh, axis, std::move(ascending), progress);
    std::vector<Slice> slices(heights.size());
    tbb::parallel_for(std::size_t(0), order.size(), [&](std::size_t n) {
        slices[order[n]] = {heights[order[n]], planes.contours(n)};
        progress.advance();
    });
    progress.endStage();
    return slices;
}

} // namespace mpuvdb
