#include "winding_number.h"

#include <cmath>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

/// Distance from a node's center, radii, from which on two terms stand for the node.
/// [paper: Barill18]
constexpr double kOpenness = 2;

/// Largest difference of a closed mesh's number from an integer. [derived: half of the rounding
/// limit]
constexpr double kMaxFraction = 0.25;

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

} // namespace

WindingNumber::WindingNumber(const TriangleTree& tree,
                             const std::vector<std::int32_t>& multiplicity, bool closed)
    : mTree(tree), mMultiplicity(multiplicity), mClosed(closed), mNodes(2 * tree.leaves()),
      mSizes(2 * tree.leaves(), 0), mBoxes(2 * tree.leaves())
{
    tbb::parallel_for(std::size_t(0), tree.leaves(), [&](std::size_t leaf) { sumLeaf(leaf); });
    for (std::size_t level = tree.leaves() / 2; level > 0; level /= 2)
        tbb::parallel_for(level, 2 * level, [&](std::size_t node) { sumChildren(node); });
    mSizes = {};
    mBoxes = {};
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

double WindingNumber::solidAngle(std::size_t slot, const Vec3d& p) const
{
    // [vanOosterom83]
    const TriangleTree::Corners& t = mTree.corners(slot);
    const Vec3d a = t[0].cast<double>() - p, b = t[1].cast<double>() - p,
                c = t[2].cast<double>() - p;
    const double la = a.norm(), lb = b.norm(), lc = c.norm();
    const double above = a.dot(b.cross(c));
    const double below = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    return above == 0 ? 0 : 2 * std::atan2(above, below); // 0 in the triangle's plane
}

double WindingNumber::sum(const Vec3d& p, double openness) const
{
    double angle = 0;
    std::size_t stack[64];
    std::size_t height = 0;
    stack[height++] = 1;
    while (height > 0) {
        const std::size_t n = stack[--height];
        const Node& node = mNodes[n];
        const Vec3d r = node.center.cast<double>() - p;
        const double squared = r.squaredNorm(), near = openness * double(node.radius);
        if (squared > near * near) {
            const double inverse = 1 / squared, cubed = inverse / std::sqrt(squared);
            const Eigen::Matrix3d moment = node.moment.cast<double>();
            angle += cubed * (node.area.cast<double>().dot(r) + moment.trace() -
                              3 * inverse * r.dot(moment * r));
        } else if (n < mTree.leaves()) {
            stack[height++] = 2 * n;
            stack[height++] = 2 * n + 1;
        } else {
            const std::size_t leaf = n - mTree.leaves();
            for (std::size_t slot = mTree.firstSlot(leaf); slot < mTree.firstSlot(leaf + 1); ++slot)
                angle += timesOf(slot) * solidAngle(slot, p);
        }
    }
    return angle / (4 * M_PI);
}

double WindingNumber::at(const Vec3d& p) const
{
    double openness = kOpenness;
    double number = sum(p, openness);
    while (mClosed && std::abs(number - std::round(number)) > kMaxFraction && openness < 1e3) {
        openness *= 4;
        number = sum(p, openness);
    }
    return mClosed ? std::round(number) : number;
}

/// The change of the number along the segment from @a a to @a b by one triangle: +1 from its front
/// to its back, -1 the other way, 0 without a crossing; none where rounding leaves it open.
std::optional<int> WindingNumber::crossing(std::size_t slot, const Vec3d& a, const Vec3d& b) const
{
    /// Relative error of volumes. [derived: roundings of products of three lengths, thousandfold]
    constexpr double kRounding = 1e-12;
    const TriangleTree::Corners& t = mTree.corners(slot);
    const std::array<Vec3d, 3> toCorner = {t[0].cast<double>() - a, t[1].cast<double>() - a,
                                           t[2].cast<double>() - a};
    const Vec3d along = b - a;
    double reach = along.cwiseAbs().maxCoeff();
    for (const Vec3d& to : toCorner) reach = std::max(reach, to.cwiseAbs().maxCoeff());
    const Vec3d normal = (toCorner[1] - toCorner[0]).cross(toCorner[2] - toCorner[0]);
    const double sure = kRounding * reach * reach * reach;
    const double heightA = -normal.dot(toCorner[0]), heightB = heightA + normal.dot(along);
    if ((heightA > sure && heightB > sure) || (heightA < -sure && heightB < -sure)) return 0;
    int left = 0, right = 0; // number of edges that it passes on each side
    for (std::size_t k = 0; k < 3; ++k) {
        const double volume = along.dot(toCorner[k].cross(toCorner[(k + 1) % 3]));
        left += volume > sure;
        right += volume < -sure;
    }
    if (left > 0 && right > 0) return 0;
    if (left + right < 3 || std::abs(heightA) <= sure || std::abs(heightB) <= sure)
        return std::nullopt;
    return heightA > 0 ? 1 : -1;
}

double WindingNumber::from(const Vec3d& known, double number, const Vec3d& p) const
{
    if (!mClosed) return at(p);
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
