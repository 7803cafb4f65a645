#include <mpuvdb/given_level_set.h>

#include "band_limits.h"
#include "core/clones.h"
#include "core/quantile.h"
#include "has_inside.h"
#include "leaf_words.h"
#include "prune.h"
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <openvdb/tools/ChangeBackground.h>
#include <openvdb/tree/LeafManager.h>
#include <optional>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

using openvdb::FloatGrid;
using openvdb::FloatTree;
using Leaf = FloatLeaf;

/// Difference from the background, relative to it, up to which a value is the background.
/// [derived: eighty roundings of a float]
constexpr float kRounding = 1e-5f;

std::vector<const Leaf*> leavesOf(const FloatTree& tree)
{
    std::vector<const Leaf*> leaves;
    leaves.reserve(tree.leafCount());
    tree.getNodes(leaves);
    return leaves;
}

/// The concatenation of @a parts.
std::vector<float> joined(const std::vector<std::vector<float>>& parts)
{
    std::vector<float> all;
    for (const std::vector<float>& part : parts) all.insert(all.end(), part.begin(), part.end());
    return all;
}

/// Largest magnitudes of active values outside and inside.
struct Extremes {
    float outside = 0, inside = 0;

    void join(const Extremes& other)
    {
        outside = std::max(outside, other.outside);
        inside = std::max(inside, other.inside);
    }
};

MPUVDB_CLONES Extremes extremesOf(const Leaf& leaf, const SignWords& active)
{
    using Flags = std::int32_t __attribute__((vector_size(sizeof(LeafLanes))));
    const Flags bits{1, 2, 4, 8, 16, 32, 64, 128};
    LeafLanes highest{}, lowest{};
    for (int row = 0; row < int(Leaf::SIZE / Leaf::DIM); ++row) {
        const auto on = std::int32_t(active[std::size_t(row / 8)] >> row % 8 * 8 & 0xff);
        if (on == 0) continue;
        auto v = lanesAt<LeafLanes>(leaf.buffer().data() + row * int(Leaf::DIM));
        if (on != 0xff) v = (bits & on) != 0 ? v : LeafLanes{};
        highest = v > highest ? v : highest;
        lowest = v < lowest ? v : lowest;
    }
    Extremes extremes;
    for (int n = 0; n < int(Leaf::DIM); ++n) extremes.join({highest[n], -lowest[n]});
    return extremes;
}

/// Counts that show how wide a band is.
struct Band {
    std::uint64_t active = 0,
                  beyond = 0;       ///< active voxels; those of them at the background or beyond
    std::uint64_t odd = 0;          ///< inactive voxels of another value than the background's
    std::vector<float> rims;        ///< magnitudes of the values where the band ends
    std::vector<Extremes> extremes; ///< by leaf
};

Band measureBand(const FloatTree& tree, const std::vector<const Leaf*>& leaves, float limit,
                 const Interrupter& progress)
{
    const float background = tree.background();
    std::vector<Band> bands(leaves.size());
    std::vector<std::vector<float>> rims(leaves.size());
    std::vector<Extremes> extremes(leaves.size());
    tbb::parallel_for(std::size_t(0), leaves.size(), [&](std::size_t n) {
        progress.check();
        const Leaf& leaf = *leaves[n];
        Band& band = bands[n];
        const SignWords inside = insideOf(leaf);
        const SignWords active = activeOf(leaf);
        SignWords inBand = wordsOf(leaf, [&](const LeafLanes& v) { return magnitude(v) < limit; });
        const SignWords usual = wordsOf(leaf, [&](const LeafLanes& v) {
            return magnitude(magnitude(v) - background) <= kRounding * background;
        });
        for (std::size_t x = 0; x < inBand.size(); ++x) {
            inBand[x] &= active[x];
            band.odd += std::uint64_t(bitsIn(~active[x] & ~usual[x]));
        }
        extremes[n] = extremesOf(leaf, active);
        band.active = leaf.onVoxelCount();
        band.beyond = band.active;
        for (int x = 0; x <= kLastInLeaf; ++x) {
            const std::uint64_t own = inBand[std::size_t(x)], sign = inside[std::size_t(x)];
            band.beyond -= std::uint64_t(bitsIn(own));
            std::uint64_t ends = 0;
            for (const Toward& to : kTowardFaces)
                ends |= own & to.within(x) & ~to.of(inBand, x) & ~(sign ^ to.of(inside, x));
            forEachBit(ends, [&](int bit) {
                rims[n].push_back(std::abs(leaf.getValue(openvdb::Index(64 * x + bit))));
            });
        }
    });
    Band whole;
    for (const Band& band : bands) {
        whole.active += band.active;
        whole.beyond += band.beyond;
        whole.odd += band.odd;
    }
    whole.rims = joined(rims);
    whole.extremes = std::move(extremes);
    return whole;
}

/// The half-width of the band, voxels, to a quarter of a voxel; none if it ends nowhere. A complete
/// band ends less than a voxel within its half-width.
std::optional<double> measuredWidth(Band& band, double voxelSize)
{
    constexpr double kMaxMissingRim =
        0.1; ///< share of the rim that may be missing [tuned: given_level_set_test]
    constexpr double kStepsPerVoxel = 4; ///< steps per voxel [tuned: given_level_set_test]
    if (band.rims.empty()) return std::nullopt;
    const double least = quantile(band.rims, kMaxMissingRim) / voxelSize;
    const double most = quantile(band.rims, 1) / voxelSize;
    return std::min(std::ceil(kStepsPerVoxel * most), std::floor(kStepsPerVoxel * (least + 1))) /
           kStepsPerVoxel;
}

/// Whether some voxel of @a leaf and its neighbors, which are on all axes, lie at @a most (outside
/// 1, inside -1) as far as they are active: no distance has such a voxel.
bool isFlatAt(const Leaf& leaf, float most, float side)
{
    const SignWords active = activeOf(leaf);
    SignWords at = wordsOf(leaf, [&](const LeafLanes& v) { return v * side >= most; });
    for (std::size_t x = 0; x < at.size(); ++x) at[x] &= active[x];
    for (int x = 1; x < kLastInLeaf; ++x) {
        std::uint64_t flat = at[std::size_t(x)];
        for (int axis = 0; axis < 3; ++axis) {
            std::uint64_t some = 0;
            for (const Toward& to : {Toward{axis, -1}, Toward{axis, 1}}) {
                const std::uint64_t there = to.of(active, x);
                some |= there;
                flat &= to.within(x) & ~(there & ~to.of(at, x));
            }
            flat &= some;
        }
        if (flat) return true;
    }
    return false;
}

/// The magnitude at which values are clipped: the largest one of a side, where it does not change
/// from voxel to voxel; of two sides the smaller one.
std::optional<float> clippedAt(const std::vector<const Leaf*>& leaves,
                               const std::vector<Extremes>& extremes)
{
    Extremes whole;
    for (const Extremes& part : extremes) whole.join(part);
    const auto isFlat = [&](float most, float side, float Extremes::*of) {
        const float least = most * (1 - kRounding);
        for (std::size_t n = 0; n < leaves.size(); ++n)
            if (extremes[n].*of >= least && isFlatAt(*leaves[n], least, side)) return most > 0;
        return false;
    };
    std::optional<float> clipped;
    if (isFlat(whole.outside, 1, &Extremes::outside)) clipped = whole.outside;
    if (isFlat(whole.inside, -1, &Extremes::inside))
        clipped = std::min(clipped.value_or(whole.inside), whole.inside);
    return clipped;
}

bool hasActiveTiles(const FloatTree& tree)
{
    auto tile = tree.cbeginValueOn();
    tile.setMaxDepth(FloatTree::ValueOnCIter::LEAF_DEPTH - 1);
    return bool(tile);
}

/// A copy of @a grid with another background, in which values beyond it are inactive.
FloatGrid::Ptr cutOff(const FloatGrid& grid, float background)
{
    FloatGrid::Ptr made = grid.deepCopy();
    FloatTree& tree = made->tree();
    auto tile = tree.beginValueOn();
    tile.setMaxDepth(FloatTree::ValueOnIter::LEAF_DEPTH - 1);
    for (; tile; ++tile) tile.setActiveState(false);
    const float limit = background * (1 - kRounding);
    openvdb::tree::LeafManager<FloatTree> leaves(tree);
    leaves.foreach ([limit](Leaf& leaf, std::size_t) {
        for (auto on = leaf.beginValueOn(); on; ++on)
            if (!(std::abs(*on) < limit)) on.setValueOff();
    });
    openvdb::tools::changeLevelSetBackground(tree, background);
    pruneBand(tree);
    return made;
}

} // namespace

LevelSet levelSetFromGrid(const FloatGrid::ConstPtr& grid, std::vector<std::string>& notes,
                          Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    /// Share of active voxels at the background that rounding may put there.
    /// [tuned: given_level_set_test]
    constexpr double kMaxBeyond = 0.01;
    /// Excess of the background over the band that is left as it is, voxels.
    /// [tuned: given_level_set_test]
    constexpr double kMaxExcess = 2;
    const LevelSet given(grid);
    requireFinite(*grid);
    progress.check();
    const double h = given.voxelSize(), promised = given.halfWidth();
    if (!grid->empty() && !hasInside(grid->tree())) {
        notes.push_back(fmt::format("grid '{}': none of its values is negative, so that it has no "
                                    "surface: it is empty",
                                    grid->getName()));
        return emptyLevelSet(given.lattice(), std::clamp(promised, kMinHalfWidth, kMaxHalfWidth),
                             grid->getName());
    }
    const float background = grid->background(), limit = background * (1 - kRounding);
    const std::vector<const Leaf*> leaves = leavesOf(grid->tree());
    const bool hasTiles = hasActiveTiles(grid->tree());
    Band band = measureBand(grid->tree(), leaves, limit, progress);
    const bool isFull = hasTiles || double(band.beyond) > kMaxBeyond * double(band.active);
    const bool isNarrow = isFull && promised < kMinHalfWidth; // the values beyond it are the band
    if (isNarrow)
        band = measureBand(grid->tree(), leaves, std::numeric_limits<float>::max(), progress);
    const std::optional<double> measured = measuredWidth(band, h);
    const std::optional<float> clipped = clippedAt(leaves, band.extremes);
    progress.check();
    std::optional<double> held; // half-width
    if (clipped && (*clipped < limit || isNarrow))
        held = *clipped / h;
    else if (measured && (promised > *measured + kMaxExcess || isNarrow))
        held = measured;
    if (held && *held >= 1) {
        notes.push_back(fmt::format("grid '{}': its background promises a band of {:.4g} voxels, "
                                    "and there are {:.4g}: the background was set to {:.4g}",
                                    grid->getName(), promised, *held, *held * h));
        return LevelSet(cutOff(*grid, float(*held * h)));
    }
    return isFull || band.odd > 0 ? LevelSet(cutOff(*grid, background)) : given;
}

} // namespace mpuvdb
