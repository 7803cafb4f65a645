#include "triangle_tree.h"

#include "core/morton.h"
#include "point_triangle.h"
#include <mpuvdb/interrupter.h>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <utility>

namespace mpuvdb
{
namespace
{

constexpr std::size_t kLeafTriangles = 4; ///< of a leaf; [free: the same distances]
constexpr int kCurveBits = 21;            ///< per axis; [derived: what mortonKey() takes]
constexpr std::size_t kMostLevels = 64;   ///< [derived: of a tree of halves of 2^64]

double squaredDistanceTo(const TriangleTree::Corners& corners, const Vec3d& p)
{
    return squaredDistance(
        p, {corners[0].cast<double>(), corners[1].cast<double>(), corners[2].cast<double>()});
}

double squaredDistanceTo(const TriangleTree::Box& box, const Vec3d& p)
{
    const Vec3d lower = box.min().cast<double>() - p, upper = p - box.max().cast<double>();
    return lower.cwiseMax(upper).cwiseMax(0).squaredNorm();
}

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

double TriangleTree::squaredDistance(const Vec3d& p, std::size_t& slot) const
{
    struct Entry {
        std::size_t node;
        double distance2;
    };
    double best = squaredDistanceTo(mCorners[slot], p);
    Entry stack[2 * kMostLevels];
    std::size_t height = 0;
    stack[height++] = {1, squaredDistanceTo(mBoxes[1], p)};
    while (height > 0) {
        const Entry entry = stack[--height];
        if (!(entry.distance2 < best)) continue;
        if (entry.node >= mLeaves) {
            const std::size_t leaf = entry.node - mLeaves;
            for (std::size_t s = firstSlot(leaf); s < firstSlot(leaf + 1); ++s) {
                const double distance2 = squaredDistanceTo(mCorners[s], p);
                if (!(distance2 < best)) continue;
                best = distance2;
                slot = s;
            }
            continue;
        }
        Entry near = {2 * entry.node, squaredDistanceTo(mBoxes[2 * entry.node], p)};
        Entry far = {2 * entry.node + 1, squaredDistanceTo(mBoxes[2 * entry.node + 1], p)};
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
            if (squaredDistanceTo(mBoxes[node], p) > most) continue;
            if (node < mLeaves) {
                stack[height++] = 2 * node;
                stack[height++] = 2 * node + 1;
                continue;
            }
            const std::size_t leaf = node - mLeaves;
            for (std::size_t s = firstSlot(leaf); s < firstSlot(leaf + 1); ++s) {
                if (squaredDistanceTo(mCorners[s], p) > most) continue;
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

} // namespace mpuvdb
