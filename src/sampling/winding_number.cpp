#include "winding_number.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tbb/parallel_for.h>
#include <utility>

namespace mpuvdb
{
namespace
{

/// Distance from a node's center, radii, from which on two terms stand for the node.
/// [paper: Barill18]
constexpr double kOpenness = 2;

/// Relative error of the volumes and heights that decide crossings, which are products of lengths.
/// [derived: some 30 roundings, with as much again]
constexpr double kRounding = 64 * std::numeric_limits<double>::epsilon();

Vec3d areaVector(const TriangleTree::Corners& t)
{
    const Vec3d a = t[0].cast<double>();
    return 0.5 * (t[1].cast<double>() - a).cross(t[2].cast<double>() - a);
}

/// Distance from @a p to the farthest corner of a box.
float farthest(const TriangleTree::Box& box, const Vec3f& p)
{
    return (box.max() - p).cwiseMax(p - box.min()).norm();
}

Vec3d middleOf(const TriangleTree::Corners& t)
{
    return (t[0].cast<double>() + t[1].cast<double>() + t[2].cast<double>()) / 3;
}

/// A sum of solid angles, each given by a complex number whose argument is half of it: their
/// product stands for the sum, which takes far less time than so many arctangents.
class SolidAngles
{
public:
    /// Add an angle @a times: twice the argument of x + iy. Without an effect for y = 0, the plane
    /// of a triangle.
    void add(double x, double y, double times)
    {
        /// Magnitudes of products that the next factor cannot take out of a double's range.
        /// [derived: factors are volumes, of lengths from 1e-60 to 1e60]
        constexpr double kSmall = 1e-100, kLarge = 1e100;
        if (y == 0) return;
        if (std::abs(times) != 1) {
            mOther += times * 2 * std::atan2(y, x);
            return;
        }
        if (times < 0) y = -y;
        const double u = mX * x - mY * y, v = mX * y + mY * x + 0.0; // no -0
        if (mY >= 0 && y > 0 && v < 0)
            ++mTurns;
        else if (mY < 0 && y < 0 && (v > 0 || (v == 0 && u < 0)))
            --mTurns;
        const double size = std::abs(u) + std::abs(v);
        const double scale = size > kSmall && size < kLarge ? 1 : 1 / size;
        mX = scale * u;
        mY = scale * v;
    }
    double total() const { return 2 * (std::atan2(mY, mX) + 2 * M_PI * mTurns) + mOther; }

private:
    double mX = 1, mY = 0; ///< the product, by a factor
    double mTurns = 0;     ///< by which the sum of the arguments differs from the product's
    double mOther = 0;
};

/// Add the solid angle of a triangle, seen from the origin. [vanOosterom83]
void addTriangle(const Vec3d& a, const Vec3d& b, const Vec3d& c, double times, SolidAngles& angles)
{
    const double la = a.norm(), lb = b.norm(), lc = c.norm();
    angles.add(la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb, a.dot(b.cross(c)),
               times);
}

} // namespace

WindingNumber::WindingNumber(const TriangleTree& tree, const OrientedTriangles& triangles)
    : mTree(tree), mMultiplicity(triangles.multiplicity), mNodes(2 * tree.leaves()),
      mSizes(2 * tree.leaves(), 0), mBoxes(2 * tree.leaves())
{
    findRims(triangles);
    tbb::parallel_for(std::size_t(0), tree.leaves(), [&](std::size_t leaf) { sumLeaf(leaf); });
    for (std::size_t level = tree.leaves() / 2; level > 0; level /= 2)
        tbb::parallel_for(level, 2 * level, [&](std::size_t node) { sumChildren(node); });
    mSizes = {};
    mBoxes = {};
    mIsExact = hasFewRims();
}

void WindingNumber::findRims(const OrientedTriangles& triangles)
{
    using Edge = std::pair<std::uint32_t, std::uint32_t>;
    std::vector<std::pair<Edge, std::int32_t>> edges; // those without a neighbor
    for (std::uint32_t n = 0; n < triangles.neighbors.size(); ++n)
        for (std::size_t k = 0; k < 3; ++k) {
            if (triangles.neighbors[n][k] != kNoTriangle) continue;
            const Mesh::Triangle& t = triangles.mesh.triangles[n];
            const Edge edge = std::minmax(t[k], t[(k + 1) % 3]);
            const std::int32_t times = mMultiplicity.empty() ? 1 : mMultiplicity[n];
            edges.push_back({edge, edge.first == t[k] ? times : -times});
        }
    std::sort(edges.begin(), edges.end());
    for (std::size_t n = 0; n < edges.size();) {
        const Edge edge = edges[n].first;
        std::int32_t times = 0;
        for (; n < edges.size() && edges[n].first == edge; ++n) times += edges[n].second;
        if (times != 0)
            mRims.push_back({triangles.mesh.positions[edge.first].cast<double>(),
                             triangles.mesh.positions[edge.second].cast<double>(), times});
    }
}

/// Whether the solid angles of the rims are fewer than the terms of a sum at places on the mesh,
/// which take about as long.
bool WindingNumber::hasFewRims() const
{
    constexpr std::size_t kPlaces = 16; ///< measured [free: time]
    std::size_t terms = 0;
    for (std::size_t n = 0; n < kPlaces && !mRims.empty(); ++n) {
        const Vec3d place = middleOf(mTree.corners(n * mTree.size() / kPlaces));
        visit(
            place, kOpenness, [&](const Node&, const Vec3d&) { ++terms; },
            [&](std::size_t) { ++terms; });
    }
    return mRims.empty() || mRims.size() <= terms / kPlaces;
}

double WindingNumber::timesOf(std::size_t slot) const
{
    return mMultiplicity.empty() ? 1 : mMultiplicity[mTree.triangle(slot)];
}

void WindingNumber::sumLeaf(std::size_t leaf)
{
    Vec3d center = Vec3d::Zero(), area = Vec3d::Zero();
    double size = 0;
    const std::size_t begin = mTree.firstSlot(leaf), end = mTree.firstSlot(leaf + 1);
    for (std::size_t slot = begin; slot < end; ++slot) {
        const Vec3d vector = timesOf(slot) * areaVector(mTree.corners(slot));
        area += vector;
        size += vector.norm();
        center += vector.norm() * middleOf(mTree.corners(slot));
    }
    center = size > 0 ? Vec3d(center / size) : Vec3d(middleOf(mTree.corners(begin)));
    Node& node = mNodes[mTree.leaves() + leaf];
    node.center = center.cast<float>();
    node.area = area.cast<float>();
    Eigen::Matrix3d moment = Eigen::Matrix3d::Zero();
    for (std::size_t slot = begin; slot < end; ++slot) {
        const TriangleTree::Corners& t = mTree.corners(slot);
        moment +=
            timesOf(slot) * areaVector(t) * (middleOf(t) - node.center.cast<double>()).transpose();
    }
    node.moment = moment.cast<float>();
    mBoxes[mTree.leaves() + leaf] = mTree.leafBox(leaf);
    node.radius = farthest(mBoxes[mTree.leaves() + leaf], node.center);
    mSizes[mTree.leaves() + leaf] = size;
}

void WindingNumber::sumChildren(std::size_t n)
{
    const Node &a = mNodes[2 * n], &b = mNodes[2 * n + 1];
    const double sizeA = mSizes[2 * n], sizeB = mSizes[2 * n + 1], size = sizeA + sizeB;
    Node& node = mNodes[n];
    const double share = size > 0 ? sizeB / size : 0.5;
    node.center = a.center + float(share) * (b.center - a.center);
    node.area = a.area + b.area;
    const Vec3f toA = a.center - node.center, toB = b.center - node.center;
    node.moment = a.moment + a.area * toA.transpose() + b.moment + b.area * toB.transpose();
    mBoxes[n] = mBoxes[2 * n].merged(mBoxes[2 * n + 1]);
    node.radius = std::min(farthest(mBoxes[n], node.center),
                           std::max(a.radius + toA.norm(), b.radius + toB.norm()));
    mSizes[n] = size;
}

/// Call ofNode(node, its center from p) for the nodes that are far from @a p, and ofSlot(slot) for
/// the triangles that are in none of them.
template <typename OfNode, typename OfSlot>
void WindingNumber::visit(const Vec3d& p, double openness, const OfNode& ofNode,
                          const OfSlot& ofSlot) const
{
    std::size_t stack[64];
    std::size_t height = 0;
    stack[height++] = 1;
    while (height > 0) {
        const std::size_t n = stack[--height];
        const Node& node = mNodes[n];
        const Vec3d r = node.center.cast<double>() - p;
        const double near = openness * double(node.radius);
        if (r.squaredNorm() > near * near) {
            ofNode(node, r);
        } else if (n < mTree.leaves()) {
            stack[height++] = 2 * n;
            stack[height++] = 2 * n + 1;
        } else {
            const std::size_t leaf = n - mTree.leaves();
            for (std::size_t slot = mTree.firstSlot(leaf); slot < mTree.firstSlot(leaf + 1); ++slot)
                ofSlot(slot);
        }
    }
}

double WindingNumber::sum(const Vec3d& p, double openness) const
{
    double far = 0;
    SolidAngles angles;
    visit(
        p, openness,
        [&](const Node& node, const Vec3d& r) {
            const double inverse = 1 / r.squaredNorm(), cubed = inverse * std::sqrt(inverse);
            const Eigen::Matrix3d moment = node.moment.cast<double>();
            far += cubed * (node.area.cast<double>().dot(r) + moment.trace() -
                            3 * inverse * r.dot(moment * r));
        },
        [&](std::size_t slot) {
            const TriangleTree::Corners& t = mTree.corners(slot);
            addTriangle(t[0].cast<double>() - p, t[1].cast<double>() - p, t[2].cast<double>() - p,
                        timesOf(slot), angles);
        });
    return (far + angles.total()) / (4 * M_PI);
}

/// The solid angle, seen from @a p, of the fan from the direction @a from to the rims.
double WindingNumber::fanAngle(const Vec3d& p, const Vec3d& from) const
{
    SolidAngles angles;
    for (const Rim& rim : mRims) addTriangle(from, rim.a - p, rim.b - p, rim.times, angles);
    return angles.total();
}

/// The number at @a p by the ray in a @a direction (unit) that leaves the mesh's box within
/// @a length; none where a crossing is ambiguous. The fan is a surface with the same boundary that
/// the ray does not meet.
std::optional<double> WindingNumber::alongRay(const Vec3d& p, const Vec3d& direction,
                                              double length) const
{
    const Vec3d end = p + length * direction;
    bool sure = true;
    double change = 0;
    mTree.forEachAlong(p, end, [&](std::size_t slot) {
        const std::optional<int> crossed = sure ? crossing(slot, p, end) : 0;
        if (crossed)
            change += *crossed * timesOf(slot);
        else
            sure = false;
    });
    if (!sure) return std::nullopt;
    return (mRims.empty() ? 0 : fanAngle(p, -direction) / (4 * M_PI)) - change;
}

/// The number by one of six rays, that which leaves the mesh's box first if it is not ambiguous.
std::optional<double> WindingNumber::exactAt(const Vec3d& p) const
{
    /// Sines of the angles between a ray and the axes' planes. [free: such as few meshes' edges
    /// have]
    constexpr double kTilt[2] = {0.1326, 0.0871};
    const TriangleTree::Box& box = mTree.box();
    const double beyond = double((box.max() - box.min()).norm());
    std::array<std::pair<double, int>, 6> ways; // distance to the box's side, and its number
    for (int side = 0; side < 6; ++side) {
        const int axis = side / 2;
        ways[std::size_t(side)] = {
            side % 2 ? double(box.max()[axis]) - p[axis] : p[axis] - double(box.min()[axis]), side};
    }
    std::sort(ways.begin(), ways.end());
    for (const auto& [distance, side] : ways) {
        const int axis = side / 2;
        Vec3d direction;
        direction[axis] = side % 2 ? 1 : -1;
        direction[(axis + 1) % 3] = kTilt[0];
        direction[(axis + 2) % 3] = kTilt[1];
        // Beyond the side by a part of the box, so that no triangle is at the end.
        const double length = (std::max(distance, 0.0) + beyond / 16) * direction.norm();
        if (const auto number = alongRay(p, direction.normalized(), length)) return number;
    }
    return std::nullopt; // it is on the mesh
}

double WindingNumber::at(const Vec3d& p) const
{
    if (mIsExact)
        if (const auto number = exactAt(p)) return *number;
    const double number = sum(p, kOpenness);
    return mRims.empty() ? std::round(number) : number;
}

/// The change of the number along the segment from @a a to @a b by one triangle: +1 from its front
/// to its back, -1 the other way, 0 without a crossing; none where rounding leaves it open.
std::optional<int> WindingNumber::crossing(std::size_t slot, const Vec3d& a, const Vec3d& b) const
{
    const TriangleTree::Corners& t = mTree.corners(slot);
    const Vec3d along = b - a;
    std::array<Vec3d, 3> toCorner, edge;
    double reach = along.norm(); // length of the segments whose products are taken
    for (std::size_t k = 0; k < 3; ++k) {
        toCorner[k] = t[k].cast<double>() - a;
        edge[k] = t[(k + 1) % 3].cast<double>() - t[k].cast<double>();
        reach = std::max(reach, toCorner[k].norm());
    }
    const double sure = kRounding * edge[0].norm() * edge[2].norm() * reach;
    const Vec3d normal = edge[2].cross(edge[0]);
    const double heightA = -normal.dot(toCorner[0]), heightB = heightA + normal.dot(along);
    if ((heightA > sure && heightB > sure) || (heightA < -sure && heightB < -sure)) return 0;
    int left = 0, right = 0; // number of edges that it passes on each side
    for (std::size_t k = 0; k < 3; ++k) {
        const double volume = along.dot(toCorner[k].cross(edge[k]));
        const double least = kRounding * reach * reach * edge[k].norm();
        left += volume > least;
        right += volume < -least;
    }
    if (left > 0 && right > 0) return 0;
    if (left + right < 3 || std::abs(heightA) <= sure || std::abs(heightB) <= sure)
        return std::nullopt;
    return heightA > 0 ? 1 : -1;
}

double WindingNumber::from(const Vec3d& known, double number, const Vec3d& p) const
{
    if (!mRims.empty()) return at(p);
    bool sure = true;
    double change = 0;
    mTree.forEachNear((known + p) / 2, (p - known).norm() / 2, [&](std::size_t slot) {
        const std::optional<int> crossed = crossing(slot, known, p);
        if (crossed)
            change += *crossed * timesOf(slot);
        else
            sure = false;
    });
    return sure ? number + change : at(p);
}

} // namespace mpuvdb
