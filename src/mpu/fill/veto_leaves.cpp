#include "veto_leaves.h"

#include "mpu/sample/block_kernel.h"

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

/// Difference of a leaf's value and the coarse field's from which a leaf on the other side fades,
/// in steps of the coarse field, which bridges unseen walls of cavities and bores.
/// [tuned: unseen_bench]
constexpr double kMaxSignDisagreement = 1.5;

/// Difference from which a leaf on the same side fades that finds the surface farther away, in
/// steps. [tuned: hollows_test]
constexpr double kMaxOvershoot = 0.5;

/// Distance from the surface up to which no leaf fades, in steps. [derived: where both differences
/// allow it whatever the coarse field says]
constexpr double kMinVetoDistance = std::min(kMaxOvershoot, (kMaxSignDisagreement - 1));

/// Inconsistency of @a value, a leaf's distance at its center, with the coarse field's @a other
/// there, in steps: the leaf fades from 0 to 1.
double disagreement(double value, const CoarseSample& other)
{
    const double own = std::abs(value), step = other.step;
    // A leaf without points continues those beside it, and ignores a surface that closes a hole
    // between.
    if ((value < 0) == (other.value < 0))
        return (std::min(own, other.maxDistance()) - std::abs(other.value)) / step - kMaxOvershoot;
    // Data are about as far as the leaf says: beyond, the coarse field means nothing.
    const double believed = std::min(std::abs(other.value), std::max(own, step));
    return (own + believed) / step - kMaxSignDisagreement;
}

/// A smooth step: 1 up to t = 0, 0 from t = 1 on.
double smoothFall(double t)
{
    const double x = std::clamp(t, 0.0, 1.0);
    return 1 - x * x * (3 - 2 * x);
}

void vetoLeaf(const OctreeDraft& tree, const CoarseSign& coarse, OctreeNode& node,
              const OctreeCell& cell)
{
    if (node.support <= 0) return;
    const Vec3d center = tree.root.center(cell);
    const StoredFit& stored = tree.fits[node.index];
    if (tree.holdsItsPoint(cell, stored)) return;
    const Vec3d y = center - stored.origin.cast<double>();
    const Quadric q = tree.rulingAt(stored, y);
    const double value = q.value(y) / std::max(q.gradient(y).norm(), kGradientFloor);
    if (std::abs(value) <= kMinVetoDistance * coarse.stepAt(center)) return;
    node.support *= float(smoothFall(disagreement(value, coarse.evaluate(center))));
}

} // namespace

std::vector<OctreeCell> unsupportedIn(OctreeDraft& tree)
{
    std::vector<OctreeCell> cells;
    addUnsupported(tree, 0, {}, cells);
    return cells;
}

void addUnsupported(OctreeDraft& tree, std::uint32_t root, const OctreeCell& cell,
                    std::vector<OctreeCell>& cells)
{
    tree.forEachLeaf(
        [&](const OctreeNode& node, const OctreeCell& at) {
            if (node.support < 1) cells.push_back(at);
        },
        root, cell);
}

void vetoLeaves(OctreeDraft& tree, const CoarseSign& coarse)
{
    tree.forEachLeafParallel(
        [&](OctreeNode& node, const OctreeCell& cell) { vetoLeaf(tree, coarse, node, cell); });
}

void vetoLeaves(OctreeDraft& tree, std::uint32_t root, const OctreeCell& cell,
                const CoarseSign& coarse)
{
    tree.forEachLeaf(
        [&](OctreeNode& node, const OctreeCell& at) { vetoLeaf(tree, coarse, node, at); }, root,
        cell);
}

} // namespace mpuvdb
