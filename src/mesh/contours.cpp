#include <mpuvdb/contours.h>
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <tuple>

namespace mpuvdb
{
namespace
{

/// An edge of the plane's lattice: from node (i,j) along its first (0) or second (1) axis.
struct Edge {
    int i, j, along;

    bool operator<(const Edge& other) const
    {
        return std::tie(i, j, along) < std::tie(other.i, other.j, other.along);
    }
    bool operator==(const Edge& other) const
    {
        return i == other.i && j == other.j && along == other.along;
    }
};

/// The part of a contour in a cell, from the crossing of one edge to that of another.
struct Segment {
    Edge from, to;
    Eigen::Vector2d start; ///< world units
};

/// A square of 8 x 8 cells of the plane's lattice, by its first node.
using Square = std::pair<int, int>;

/// The solid's distances on the plane.
class PlaneField
{
public:
    /// @param field  outlives this.
    PlaneField(const Field& field, const Lattice& lattice, const SlicePlane& plane)
        : mLattice(lattice), mPlane(plane), mEvaluator(field.evaluator(lattice.voxelSize))
    {
    }

    /// The distance at a place in lattice coordinates.
    double at(double i, double j) { return mEvaluator->evaluate(place(i, j)).value; }

    /// The world coordinates in the plane.
    Eigen::Vector2d world(double i, double j) const
    {
        const Vec3d p = place(i, j);
        return {p[mPlane.firstAxis()], p[mPlane.secondAxis()]};
    }

    /// Where the distance is zero on @a edge, whose ends have @a low and @a high.
    Eigen::Vector2d crossing(const Edge& edge, double low, double high)
    {
        // [derived: halves a voxel to less than 1e-5 of it, at which floats of the grid end]
        constexpr int kSteps = 18;
        double from = 0, to = 1;
        const auto along = [&](double t) {
            return std::pair(edge.i + (edge.along == 0 ? t : 0),
                             edge.j + (edge.along == 1 ? t : 0));
        };
        for (int step = 0; step < kSteps; ++step) {
            const double middle = (from + to) / 2;
            const auto [i, j] = along(middle);
            const double value = at(i, j);
            ((value < 0) == (low < 0) ? from : to) = middle;
            ((value < 0) == (low < 0) ? low : high) = value;
        }
        const double t = low != high ? from + (to - from) * low / (low - high) : from;
        const auto [i, j] = along(t);
        return world(i, j);
    }

private:
    Vec3d place(double i, double j) const
    {
        Vec3d p;
        p[mPlane.axis] = mPlane.height;
        p[mPlane.firstAxis()] = mLattice.origin[mPlane.firstAxis()] + mLattice.voxelSize * i;
        p[mPlane.secondAxis()] = mLattice.origin[mPlane.secondAxis()] + mLattice.voxelSize * j;
        return p;
    }

    Lattice mLattice;
    SlicePlane mPlane;
    std::unique_ptr<PointEvaluator> mEvaluator;
};

/// The squares that may hold a contour, sorted: those of leaves at the plane, and those before
/// them, whose last cells end at nodes of the leaves.
std::vector<Square> squaresAt(const LevelSet& levelSet, const SlicePlane& plane)
{
    const Lattice lattice = levelSet.lattice();
    const double layer =
        std::floor((plane.height - lattice.origin[plane.axis]) / lattice.voxelSize);
    std::vector<Square> squares;
    for (auto leaf = levelSet.grid().tree().cbeginLeaf(); leaf; ++leaf) {
        const openvdb::Coord& at = leaf->origin();
        const double first = at[plane.axis];
        if (layer + 1 < first || layer >= first + kBlockDim) continue;
        const int i = at[plane.firstAxis()], j = at[plane.secondAxis()];
        for (const int di : {0, kBlockDim})
            for (const int dj : {0, kBlockDim}) squares.emplace_back(i - di, j - dj);
    }
    std::sort(squares.begin(), squares.end());
    squares.erase(std::unique(squares.begin(), squares.end()), squares.end());
    return squares;
}

/// Adds the parts of contours in the cell whose first node is (u,v).
/// @param corner  the distances at its corners, counter-clockwise.
void addSegments(PlaneField& field, int u, int v, const std::array<double, 4>& corner,
                 std::vector<Segment>& segments)
{
    const auto isInside = [&](int n) { return corner[std::size_t(n % 4)] < 0; };
    const auto leaves = [&](int n) { return isInside(n) && !isInside(n + 1); };
    const int starts = leaves(0) + leaves(1) + leaves(2) + leaves(3);
    if (starts == 0) return;
    // The edges after the corners.
    const std::array<Edge, 4> edges = {{{u, v, 0}, {u + 1, v, 1}, {u, v + 1, 0}, {u, v, 1}}};
    // Where two corners across from each other are inside, the middle says whether they are joined.
    const bool isJoined = starts == 2 && field.at(u + 0.5, v + 0.5) < 0;
    for (int n = 0; n < 4; ++n) {
        if (!leaves(n)) continue;
        // With the solid to the left, a contour ends where the corners become inside again.
        int end = n + 1;
        if (starts == 2)
            end = isJoined ? n + 1 : n + 3;
        else
            while (isInside(end) || !isInside(end + 1)) ++end;
        const Edge& edge = edges[std::size_t(n)];
        const double here = corner[std::size_t(n)], next = corner[std::size_t((n + 1) % 4)];
        const bool isForward = n < 2; // the last two edges run against their axis
        segments.push_back(
            {edge, edges[std::size_t(end % 4)],
             field.crossing(edge, isForward ? here : next, isForward ? next : here)});
    }
}

/// Adds the parts of contours in the cells of @a square.
void addSegments(PlaneField& field, const Square& square, std::vector<Segment>& segments)
{
    constexpr std::size_t kNodes = kBlockDim + 1; // along a side [derived: one more than cells]
    std::array<std::array<double, kNodes>, kNodes> values{};
    const auto& [first, second] = square;
    for (std::size_t i = 0; i < kNodes; ++i)
        for (std::size_t j = 0; j < kNodes; ++j)
            values[i][j] = field.at(first + int(i), second + int(j));
    for (std::size_t i = 0; i + 1 < kNodes; ++i)
        for (std::size_t j = 0; j + 1 < kNodes; ++j)
            addSegments(field, first + int(i), second + int(j),
                        {values[i][j], values[i + 1][j], values[i + 1][j + 1], values[i][j + 1]},
                        segments);
}

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

/// Joins segments, sorted by their first edges, to contours.
std::vector<Contour> joined(const std::vector<Segment>& segments, const SlicePlane& plane)
{
    std::vector<Contour> contours;
    std::vector<bool> isUsed(segments.size());
    for (std::size_t first = 0; first < segments.size(); ++first) {
        if (isUsed[first]) continue;
        Contour contour;
        for (std::size_t at = first; !isUsed[at];) {
            isUsed[at] = true;
            const Segment& segment = segments[at];
            if (contour.points.empty() || contour.points.back() != segment.start)
                contour.points.push_back(segment.start);
            const auto next =
                std::lower_bound(segments.begin(), segments.end(), segment.to,
                                 [](const Segment& s, const Edge& edge) { return s.from < edge; });
            if (next == segments.end() || !(next->from == segment.to))
                throw InputError(fmt::format(
                    "the band ends on the plane {} = {} near ({:.6g}, {:.6g}), so that contours "
                    "are not closed there. Look at the grid with mpuvdb check",
                    "xyz"[plane.axis], plane.height, segment.start.x(), segment.start.y()));
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

std::vector<Contour> contoursOf(const LevelSet& levelSet, const SlicePlane& plane,
                                Interrupter* interrupter)
{
    const Interrupter& progress = orSilent(interrupter);
    if (plane.axis < 0 || plane.axis > 2 || !std::isfinite(plane.height))
        throw UsageError(fmt::format("slice: axis {} at height {}; the axis must be 0, 1 or 2, and "
                                     "the height finite",
                                     plane.axis, plane.height));
    const std::vector<Square> squares = squaresAt(levelSet, plane);
    progress.check();
    std::vector<std::vector<Segment>> parts(squares.size());
    const FieldPtr solid = makeGridField(levelSet);
    const Lattice lattice = levelSet.lattice();
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, squares.size()), [&](const auto& range) {
        PlaneField field(*solid, lattice, plane);
        for (std::size_t n = range.begin(); n < range.end(); ++n) {
            addSegments(field, squares[n], parts[n]);
            progress.check();
        }
    });
    std::vector<Segment> segments;
    for (const std::vector<Segment>& part : parts)
        segments.insert(segments.end(), part.begin(), part.end());
    std::sort(segments.begin(), segments.end(),
              [](const Segment& a, const Segment& b) { return a.from < b.from; });
    return joined(segments, plane);
}

} // namespace mpuvdb
