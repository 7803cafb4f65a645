#include "convex_pieces.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

namespace mpuvdb
{
namespace
{

double cross(const Vec2d& a, const Vec2d& b)
{
    return a[0] * b[1] - a[1] * b[0];
}

/// A directed line: heights are positive to its left.
struct Line {
    Vec2d origin, along; ///< along has length 1

    explicit Line(const PlaneSegment& s) : origin(s[0]), along((s[1] - s[0]).normalized()) {}
    double height(const Vec2d& p) const { return cross(along, p - origin); }
};

/// The part of @a segment inside a convex polygon, deeper than @a point; none unless it is longer
/// than @a point.
std::optional<PlaneSegment> clipped(const PlaneSegment& segment, const PlanePolygon& polygon,
                                    double point)
{
    double first = 0, last = 1;
    for (std::size_t k = 0; k < polygon.size(); ++k) {
        const Vec2d &from = polygon[k], &to = polygon[(k + 1) % polygon.size()];
        if (!((to - from).norm() > point)) continue;
        const Line side({from, to});
        const double a = side.height(segment[0]) - point, b = side.height(segment[1]) - point;
        if (a <= 0 && b <= 0) return std::nullopt;
        if (a < 0) first = std::max(first, a / (a - b));
        if (b < 0) last = std::min(last, a / (a - b));
    }
    const Vec2d along = segment[1] - segment[0];
    if (!((last - first) * along.norm() > point)) return std::nullopt;
    return PlaneSegment{segment[0] + first * along, segment[0] + last * along};
}

/// The parts of @a polygon to the left and to the right of a line. Corners within @a point of the
/// line are on it.
std::array<PlanePolygon, 2> split(const PlanePolygon& polygon, const Line& line, double point)
{
    const auto heightOf = [&](const Vec2d& p) {
        const double height = line.height(p);
        return std::abs(height) > point ? height : 0;
    };
    std::array<PlanePolygon, 2> sides;
    for (std::size_t k = 0; k < polygon.size(); ++k) {
        const Vec2d &p = polygon[k], &q = polygon[(k + 1) % polygon.size()];
        const double hp = heightOf(p), hq = heightOf(q);
        if (hp >= 0) sides[0].push_back(p);
        if (hp <= 0) sides[1].push_back(p);
        if ((hp < 0 && hq > 0) || (hp > 0 && hq < 0)) {
            const Vec2d at = p + hp / (hp - hq) * (q - p);
            sides[0].push_back(at);
            sides[1].push_back(at);
        }
    }
    return sides;
}

/// The longest of the segments: lines along short ones would cut distant parts.
std::size_t longestOf(const std::vector<PlaneSegment>& segments)
{
    const auto squaredLength = [](const PlaneSegment& s) { return (s[1] - s[0]).squaredNorm(); };
    return std::size_t(std::max_element(segments.begin(), segments.end(),
                                        [&](const PlaneSegment& a, const PlaneSegment& b) {
                                            return squaredLength(a) < squaredLength(b);
                                        }) -
                       segments.begin());
}

} // namespace

std::vector<PlanePolygon> cutAlong(PlanePolygon polygon, std::vector<PlaneSegment> segments,
                                   double point)
{
    struct Work {
        PlanePolygon polygon;
        std::vector<PlaneSegment> segments; ///< that may cross it
    };
    std::vector<PlanePolygon> pieces;
    std::vector<Work> stack;
    stack.push_back({std::move(polygon), std::move(segments)});
    while (!stack.empty()) {
        Work work = std::move(stack.back());
        stack.pop_back();
        std::vector<PlaneSegment> within;
        for (const PlaneSegment& s : work.segments)
            if (const auto part = clipped(s, work.polygon, point)) within.push_back(*part);
        if (within.empty()) {
            if (work.polygon.size() > 2) pieces.push_back(std::move(work.polygon));
            continue;
        }
        const std::size_t chosen = longestOf(within);
        const Line line(within[chosen]);
        within.erase(within.begin() + std::ptrdiff_t(chosen));
        auto sides = split(work.polygon, line, point);
        stack.push_back({std::move(sides[0]), within});
        stack.push_back({std::move(sides[1]), std::move(within)});
    }
    return pieces;
}

} // namespace mpuvdb
