#include "triangle_tree.h"

#include "core/morton.h"
#include "point_triangle.h"
#include <mpuvdb/interrupter.h>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace mpuvdb
{
namespace
{

/// Levels above the leaves whose nodes have cylinders. [free: time]
constexpr int kCylinderLevels = 6;
constexpr int kCurveBits = 21; ///< per axis; [derived: what mortonKey() takes]

/// A ray, and its intersections. The axes are permuted and sheared so that the ray runs along z:
/// then triangles on both sides of an edge compute the same product for it, and none lets a ray
/// through that the other would have met [Woop13].
class Ray
{
public:
    Ray(const Vec3d& origin, const Vec3d& direction)
        : mOrigin(origin), mInverse(direction.cwiseInverse())
    {
        Eigen::Index largest;
        direction.cwiseAbs().maxCoeff(&largest);
        mZ = int(largest);
        mX = (mZ + 1) % 3;
        mY = (mZ + 2) % 3;
        mShear = Vec3d(direction[mX], direction[mY], 1) / direction[mZ];
    }

    /// Where the ray enters @a box, from 0 on; infinite if it misses it.
    double enters(const TriangleTree::Box& box) const
    {
        double from = 0, to = kNone;
        for (int axis = 0; axis < 3; ++axis) {
            const double low = double(box.min()[axis]) - mOrigin[axis];
            const double high = double(box.max()[axis]) - mOrigin[axis];
            if (std::isinf(mInverse[axis])) { // along the box's sides
                if (low > 0 || high < 0) return kNone;
                continue;
            }
            const double a = low * mInverse[axis], b = high * mInverse[axis];
            from = std::max(from, std::min(a, b));
            to = std::min(to, std::max(a, b) * kRoundings);
        }
        return from <= to ? from : kNone;
    }

    /// Where the ray meets a triangle, from 0 on; infinite if it misses it.
    double meets(const TriangleTree::Corners& corners) const
    {
        const Vec3d a = sheared(corners[0]), b = sheared(corners[1]), c = sheared(corners[2]);
        const double u = c[0] * b[1] - c[1] * b[0], v = a[0] * c[1] - a[1] * c[0];
        const double w = b[0] * a[1] - b[1] * a[0];
        if ((u < 0 || v < 0 || w < 0) && (u > 0 || v > 0 || w > 0)) return kNone;
        const double sum = u + v + w;
        if (sum == 0) return kNone;
        const double t = (u * a[2] + v * b[2] + w * c[2]) / sum;
        return t >= 0 ? t : kNone;
    }

    /// Of no hit. [derived: infinity]
    static constexpr double kNone = std::numeric_limits<double>::infinity();

private:
    /// Factor on where a ray leaves a box. [derived: three roundings of a double, doubled]
    static constexpr double kRoundings = 1 + 0x1p-50;

    Vec3d sheared(const Vec3f& corner) const
    {
        const Vec3d to = corner.cast<double>() - mOrigin;
        return Vec3d(to[mX] - mShear[0] * to[mZ], to[mY] - mShear[1] * to[mZ], mShear[2] * to[mZ]);
    }

    Vec3d mOrigin, mInverse, mShear;
    int mX, mY, mZ;
};

} // namespace

TriangleTree::TriangleTree(const Mesh& mesh, Interrupter& progress)
{
    sortTriangles(mesh);
    progress.check();
    mCorners.resize(size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, size(), 4096), [&](const auto& range) {
        for (std::size_t slot = range.begin(); slot < range.end(); ++slot)
            for (std::size_t k = 0; k < 3; ++k)
                mCorners[slot][k] = mesh.positions[mesh.triangles[mOrder[slot]][k]];
    });
    while (mLeaves * kLeafTriangles < size()) mLeaves *= 2;
    boundNodes(progress);
}

std::uint64_t TriangleTree::bytesFor(std::uint64_t triangles)
{
    std::uint64_t leaves = 1;
    while (leaves * kLeafTriangles < triangles) leaves *= 2;
    const std::uint64_t sorting = triangles * sizeof(std::pair<std::uint64_t, std::uint32_t>),
                        nodes = triangles * sizeof(Corners) +
                                2 * leaves * (sizeof(Box) + sizeof(Cylinder));
    return triangles * sizeof(std::uint32_t) + std::max(sorting, nodes);
}

void TriangleTree::boundNodes(Interrupter& progress)
{
    mBoxes.resize(2 * mLeaves);
    tbb::parallel_for(std::size_t(0), mLeaves, [&](std::size_t leaf) {
        for (std::size_t slot = firstSlot(leaf); slot < firstSlot(leaf + 1); ++slot)
            for (const Vec3f& corner : mCorners[slot]) mBoxes[mLeaves + leaf].extend(corner);
    });
    for (std::size_t level = mLeaves / 2; level > 0; level /= 2) {
        progress.check();
        tbb::parallel_for(level, 2 * level, [&](std::size_t node) {
            mBoxes[node] = mBoxes[2 * node].merged(mBoxes[2 * node + 1]);
        });
    }
    mFirstCylinder = std::max<std::size_t>(mLeaves >> kCylinderLevels, 1);
    mCylinders.resize(2 * mLeaves - mFirstCylinder);
    tbb::parallel_for(tbb::blocked_range<std::size_t>(mFirstCylinder, 2 * mLeaves, 64),
                      [&](const auto& range) {
                          progress.check();
                          for (std::size_t node = range.begin(); node < range.end(); ++node)
                              mCylinders[node - mFirstCylinder] = cylinderOf(node);
                      });
}

std::pair<std::size_t, std::size_t> TriangleTree::slotsBelow(std::size_t node) const
{
    std::size_t first = node, last = node + 1;
    while (first < mLeaves) {
        first *= 2;
        last *= 2;
    }
    return {firstSlot(first - mLeaves), firstSlot(last - mLeaves)};
}

TriangleTree::Cylinder TriangleTree::cylinderOf(std::size_t node) const
{
    const auto [begin, end] = slotsBelow(node);
    Vec3d sum = Vec3d::Zero();
    for (std::size_t slot = begin; slot < end; ++slot) {
        const auto& [a, b, c] = mCorners[slot];
        sum += (b - a).cast<double>().cross((c - a).cast<double>());
    }
    Cylinder cylinder;
    if (sum.squaredNorm() > 0) cylinder.axis = sum.normalized().cast<float>();
    const Vec3d axis = cylinder.axis.cast<double>(), center = middle(node);
    double low = std::numeric_limits<double>::infinity(), high = -low, radius = 0;
    for (std::size_t slot = begin; slot < end; ++slot)
        for (const Vec3f& corner : mCorners[slot]) {
            const Vec3d from = corner.cast<double>() - center;
            const double along = axis.dot(from);
            low = std::min(low, along);
            high = std::max(high, along);
            radius = std::max(radius, from.squaredNorm() - along * along);
        }
    constexpr float kMost = std::numeric_limits<float>::max(); ///< [derived: the type's largest]
    cylinder.low = std::nextafter(float(low), -kMost);
    cylinder.high = std::nextafter(float(high), kMost);
    cylinder.radius = std::nextafter(float(std::sqrt(radius)), kMost);
    return cylinder;
}

void TriangleTree::sortTriangles(const Mesh& mesh)
{
    Box box;
    for (const Vec3f& p : mesh.positions) box.extend(p);
    const double cells = double((1 << kCurveBits) - 1);
    const double scale = cells / std::max(double(box.sizes().maxCoeff()), 1e-300);
    std::vector<std::pair<std::uint64_t, std::uint32_t>> keys(mesh.triangles.size());
    tbb::parallel_for(std::size_t(0), keys.size(), [&](std::size_t t) {
        Vec3d middle = Vec3d::Zero();
        for (const std::uint32_t v : mesh.triangles[t])
            middle += (mesh.positions[v] - box.min()).cast<double>() / 3;
        const Vec3d cell = (scale * middle).cwiseMax(0).cwiseMin(cells);
        keys[t] = {
            mortonKey(std::uint64_t(cell[0]), std::uint64_t(cell[1]), std::uint64_t(cell[2])),
            std::uint32_t(t)};
    });
    tbb::parallel_sort(keys.begin(), keys.end());
    mOrder.resize(keys.size());
    for (std::size_t slot = 0; slot < keys.size(); ++slot) mOrder[slot] = keys[slot].second;
}

double TriangleTree::squaredDistanceTo(std::size_t slot, const Vec3d& p) const
{
    const auto& [a, b, c] = mCorners[slot];
    return mpuvdb::squaredDistance(p, {a.cast<double>(), b.cast<double>(), c.cast<double>()});
}

double TriangleTree::squaredDistance(const Vec3d& p, std::size_t& slot) const
{
    return search(p, squaredDistanceTo(slot, p), slot);
}

double TriangleTree::squaredDistance(const Vec3d& p, double below, std::size_t& slot) const
{
    const std::size_t none = size();
    slot = none;
    const double found = search(p, below, slot);
    if (slot != none) return found;
    slot = 0; // where squares are infinite none is below
    return search(p, squaredDistanceTo(slot, p), slot);
}

/// The squared distance from @a p to the nearest triangle, if that is at most @a best, and its
/// slot, if that is nearer or before @a slot.
double TriangleTree::search(const Vec3d& p, double best, std::size_t& slot) const
{
    struct Entry {
        std::size_t node;
        double distance2;
    };
    Entry stack[2 * kMostLevels];
    std::size_t height = 0;
    stack[height++] = {1, squaredBound(1, p)};
    while (height > 0) {
        const Entry entry = stack[--height];
        if (!(entry.distance2 <= best)) continue;
        if (entry.node >= mLeaves) {
            const std::size_t leaf = entry.node - mLeaves;
            for (std::size_t s = firstSlot(leaf); s < firstSlot(leaf + 1); ++s) {
                const double distance2 = squaredDistanceTo(s, p);
                if (!(distance2 < best || (distance2 == best && s < slot))) continue;
                best = distance2;
                slot = s;
            }
            continue;
        }
        Entry near = {2 * entry.node, squaredBound(2 * entry.node, p)};
        Entry far = {2 * entry.node + 1, squaredBound(2 * entry.node + 1, p)};
        if (far.distance2 < near.distance2) std::swap(near, far);
        stack[height++] = far;
        stack[height++] = near;
    }
    return best;
}

bool TriangleTree::isWithin(const Vec3d& p, double distance, std::size_t& slot) const
{
    const double most = distance * distance;
    const auto isBelow = [&](std::size_t root) {
        std::size_t stack[kMostLevels];
        std::size_t height = 0;
        stack[height++] = root;
        while (height > 0) {
            const std::size_t node = stack[--height];
            if (squaredBound(node, p) > most) continue;
            if (node < mLeaves) {
                stack[height++] = 2 * node;
                stack[height++] = 2 * node + 1;
                continue;
            }
            const std::size_t leaf = node - mLeaves;
            for (std::size_t s = firstSlot(leaf); s < firstSlot(leaf + 1); ++s) {
                if (squaredDistanceTo(s, p) > most) continue;
                slot = s;
                return true;
            }
        }
        return false;
    };
    // From the leaf with this slot upwards, and each time down its sibling.
    std::size_t node = mLeaves + ((slot + 1) * mLeaves - 1) / size();
    if (isBelow(node)) return true;
    for (; node > 1; node /= 2)
        if (isBelow(node ^ 1)) return true;
    return false;
}

double TriangleTree::firstHit(const Vec3d& origin, const Vec3d& direction, std::size_t& slot) const
{
    struct Entry {
        std::size_t node;
        double from;
    };
    const Ray ray(origin, direction);
    double first = Ray::kNone;
    Entry stack[2 * kMostLevels];
    std::size_t height = 0;
    stack[height++] = {1, ray.enters(mBoxes[1])};
    while (height > 0) {
        const Entry entry = stack[--height];
        if (!(entry.from < first)) continue;
        if (entry.node >= mLeaves) {
            const std::size_t leaf = entry.node - mLeaves;
            for (std::size_t s = firstSlot(leaf); s < firstSlot(leaf + 1); ++s) {
                const double t = ray.meets(mCorners[s]);
                if (!(t < first)) continue;
                first = t;
                slot = s;
            }
            continue;
        }
        Entry near = {2 * entry.node, ray.enters(mBoxes[2 * entry.node])};
        Entry far = {2 * entry.node + 1, ray.enters(mBoxes[2 * entry.node + 1])};
        if (far.from < near.from) std::swap(near, far);
        stack[height++] = far;
        stack[height++] = near;
    }
    return first;
}

} // namespace mpuvdb
