#include <mpuvdb/given_level_set.h>

#include "band_limits.h"
#include "block_parts.h"
#include "core/lanes.h"
#include "core/quantile.h"
#include "has_inside.h"
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

using openvdb::Coord;
using openvdb::FloatGrid;
using openvdb::FloatTree;
using Leaf = FloatTree::LeafNodeType;

/// Difference from the background, relative to it, up to which a value is the background.
/// [derived: eighty roundings of a float]
constexpr float kRounding = 1e-5f;
constexpr int kLast = int(Leaf::DIM) - 1; ///< last voxel along an axis [derived: the leaf's edge]

const Coord kSteps[3] = {Coord(1, 0, 0), Coord(0, 1, 0), Coord(0, 0, 1)};

/// Bits of a leaf's voxels, as its masks have them.
using Words = SignWords;

/// A direction along an axis.
struct Toward {
    int axis, step; ///< step is 1 or -1

    /// The bits of @a words at the neighbors of the voxels with x-coordinate @a x in this leaf.
    std::uint64_t of(const Words& words, int x) const
    {
        const auto n = std::size_t(x);
        if (axis == 0) return hasNeighbor(x) ? words[n + std::size_t(step)] : 0;
        const int shift = axis == 1 ? 8 : 1;
        return step > 0 ? words[n] >> shift : words[n] << shift;
    }
    /// The voxels whose neighbor in that direction lies in this leaf.
    std::uint64_t within(int x) const
    {
        if (axis == 0) return hasNeighbor(x) ? ~std::uint64_t(0) : 0;
        if (axis == 1) return ~(step > 0 ? kLastY : kFirstY);
        return ~(step > 0 ? kLastZ : kFirstZ);
    }

private:
    bool hasNeighbor(int x) const { return x + step >= 0 && x + step <= kLast; }
};

const Toward kFaces[6] = {{0, -1}, {0, 1}, {1, -1}, {1, 1}, {2, -1}, {2, 1}};

using Lanes = float __attribute__((vector_size(sizeof(float) * Leaf::DIM)));

/// The voxels whose values satisfy @a f, which takes eight at once.
template <typename F>
Words wordsOf(const Leaf& leaf, const F& f)
{
    Words words{};
    const float* const values = leaf.buffer().data();
    for (unsigned row = 0; row < Leaf::SIZE / Leaf::DIM; ++row)
        words[row / Leaf::DIM] |= std::uint64_t(bitsOf(f(lanesAt<Lanes>(values + row * Leaf::DIM))))
                                  << (row % Leaf::DIM * Leaf::DIM);
    return words;
}

Words insideOf(const Leaf& leaf)
{
    return wordsOf(leaf, [](const Lanes& v) { return v < 0; });
}

Words activeOf(const Leaf& leaf)
{
    Words words;
    for (std::size_t x = 0; x < words.size(); ++x)
        words[x] = leaf.getValueMask().getWord<std::uint64_t>(openvdb::Index(x));
    return words;
}

template <typename F>
void forEachBit(std::uint64_t word, const F& f)
{
    for (; word; word &= word - 1) f(__builtin_ctzll(word));
}

int bitsIn(std::uint64_t word)
{
    return __builtin_popcountll(word);
}

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

/// Counts that show how wide a band is.
struct Band {
    std::uint64_t active = 0,
                  beyond = 0; ///< active voxels; those of them at the background or beyond
    std::uint64_t odd = 0;    ///< inactive voxels of another value than the background's
    std::vector<float> rims;  ///< magnitudes of the values where the band ends
};

Band measureBand(const FloatTree& tree, float limit, const Interrupter& progress)
{
    const std::vector<const Leaf*> leaves = leavesOf(tree);
    const float background = tree.background();
    std::vector<Band> bands(leaves.size());
    std::vector<std::vector<float>> rims(leaves.size());
    tbb::parallel_for(std::size_t(0), leaves.size(), [&](std::size_t n) {
        progress.check();
        const Leaf& leaf = *leaves[n];
        Band& band = bands[n];
        const Words inside = insideOf(leaf);
        const Words active = activeOf(leaf);
        Words inBand = wordsOf(leaf, [&](const Lanes& v) { return magnitude(v) < limit; });
        const Words usual = wordsOf(leaf, [&](const Lanes& v) {
            return magnitude(magnitude(v) - background) <= kRounding * background;
        });
        for (std::size_t x = 0; x < inBand.size(); ++x) {
            inBand[x] &= active[x];
            band.odd += std::uint64_t(bitsIn(~active[x] & ~usual[x]));
        }
        band.active = leaf.onVoxelCount();
        band.beyond = band.active;
        for (int x = 0; x <= kLast; ++x) {
            const std::uint64_t own = inBand[std::size_t(x)], sign = inside[std::size_t(x)];
            band.beyond -= std::uint64_t(bitsIn(own));
            std::uint64_t ends = 0;
            for (const Toward& to : kFaces)
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

/// Append the lengths of the gradient in the active voxels of @a leaf beside the zero set. Each
/// axis counts with its steeper side, so that the middle of a thin wall is as steep as its sides.
void addSlopes(const Leaf& leaf, FloatGrid::ConstAccessor& at, double voxelSize,
               std::vector<float>& slopes)
{
    for (auto on = leaf.cbeginValueOn(); on; ++on) {
        const Coord voxel = on.getCoord();
        bool crossed = false, whole = true;
        double square = 0;
        for (const Coord& step : kSteps) {
            double steepest = -1;
            for (const Coord& beside : {voxel - step, voxel + step}) {
                float value = 0;
                if (!at.probeValue(beside, value)) continue;
                crossed |= (value < 0) != (*on < 0);
                steepest = std::max(steepest, std::abs(double(value) - double(*on)) / voxelSize);
            }
            whole &= steepest >= 0;
            square += steepest * steepest;
        }
        if (crossed && whole) slopes.push_back(float(std::sqrt(square)));
    }
}

/// The median slope beside the zero set in a sample of the leaves; 1 where there is none.
double medianSlope(const FloatGrid& grid, double voxelSize, const Interrupter& progress)
{
    /// Leaves to sample: several thousand slopes. [tuned: given_level_set_test]
    constexpr std::size_t kSampledLeaves = 128;
    std::vector<const Leaf*> leaves = leavesOf(grid.tree());
    const auto isUncrossed = [&](const Leaf* leaf) {
        progress.check();
        const float* const values = leaf->buffer().data();
        return std::all_of(values, values + Leaf::SIZE, [](float v) { return v < 0; }) ||
               std::none_of(values, values + Leaf::SIZE, [](float v) { return v < 0; });
    };
    const bool isFew = leaves.size() <= kSampledLeaves; // a face may lie between leaves
    if (!isFew)
        leaves.erase(std::remove_if(leaves.begin(), leaves.end(), isUncrossed), leaves.end());
    const std::size_t stride = leaves.size() / kSampledLeaves + 1;
    std::vector<std::vector<float>> found(leaves.size());
    tbb::parallel_for(std::size_t(0), (leaves.size() + stride - 1) / stride, [&](std::size_t n) {
        FloatGrid::ConstAccessor at = grid.getConstAccessor();
        addSlopes(*leaves[n * stride], at, voxelSize, found[n]);
    });
    std::vector<float> slopes = joined(found);
    return slopes.empty() ? 1 : quantile(slopes, 0.5);
}

/// Faces between inside and outside voxels.
struct Faces {
    std::uint64_t all = 0, open = 0; ///< open: beside an inactive voxel
    Coord first;                     ///< voxel at the first open face

    void add(const Coord& at, bool isOpen, std::uint64_t count = 1)
    {
        all += count;
        if (!isOpen) return;
        if (open == 0 || at < first) first = at;
        open += count;
    }
    void join(const Faces& other)
    {
        if (other.open > 0 && (open == 0 || other.first < first)) first = other.first;
        all += other.all;
        open += other.open;
    }
};

/// Faces of @a leaf's voxels towards higher coordinates, and towards tiles.
Faces facesOf(const Leaf& leaf, FloatGrid::ConstAccessor& at)
{
    Faces faces;
    const Words inside = insideOf(leaf), on = activeOf(leaf);
    const Coord origin = leaf.origin();
    for (int x = 0; x <= kLast; ++x)
        for (int axis = 0; axis < 3; ++axis) {
            const Toward to{axis, 1};
            const auto n = std::size_t(x);
            const std::uint64_t crossed = (inside[n] ^ to.of(inside, x)) & to.within(x);
            const std::uint64_t open = crossed & ~(on[n] & to.of(on, x));
            faces.all += std::uint64_t(bitsIn(crossed));
            if (open == 0) continue;
            const int first = __builtin_ctzll(open);
            faces.add(origin.offsetBy(x, first >> 3, first & 7), true, std::uint64_t(bitsIn(open)));
            faces.all -= std::uint64_t(bitsIn(open));
        }
    for (const Toward& to : kFaces) {
        Coord beyond = origin;
        beyond[to.axis] += to.step * int(Leaf::DIM);
        const Leaf* const beside = at.probeConstLeaf(beyond);
        if (beside && to.step < 0) continue; // that leaf counts them
        const float tile = beside ? 0 : at.getValue(beyond);
        const bool isTileOn = !beside && at.isValueOn(beyond);
        const int u = (to.axis + 1) % 3, v = (to.axis + 2) % 3;
        Coord own, other;
        own[to.axis] = to.step > 0 ? kLast : 0;
        other[to.axis] = kLast - own[to.axis];
        for (own[u] = 0; own[u] <= kLast; ++own[u])
            for (own[v] = 0; own[v] <= kLast; ++own[v]) {
                other[u] = own[u];
                other[v] = own[v];
                const openvdb::Index i = Leaf::coordToOffset(own), j = Leaf::coordToOffset(other);
                const float next = beside ? beside->getValue(j) : tile;
                if ((leaf.getValue(i) < 0) == (next < 0)) continue;
                const bool isOn = beside ? beside->isValueOn(j) : isTileOn;
                faces.add(origin + own, !(isOn && leaf.isValueOn(i)));
            }
    }
    return faces;
}

/// Faces between tiles, each judged by a corner of the inside tile.
Faces facesOfTiles(const FloatGrid& grid)
{
    Faces faces;
    auto at = grid.getConstAccessor();
    auto tile = grid.tree().cbeginValueAll();
    tile.setMaxDepth(FloatTree::ValueAllCIter::LEAF_DEPTH - 1);
    for (; tile; ++tile) {
        if (!(*tile < 0)) continue;
        const openvdb::CoordBBox box = tile.getBoundingBox();
        for (int axis = 0; axis < 3; ++axis)
            for (const int end : {box.min()[axis] - 1, box.max()[axis] + 1}) {
                Coord beside = box.min();
                beside[axis] = end;
                if (at.probeConstLeaf(beside) || at.getValue(beside) < 0) continue;
                const auto dim = std::uint64_t(box.dim()[axis]);
                faces.add(box.min(), true, dim * dim);
            }
    }
    return faces;
}

Faces facesOf(const FloatGrid& grid, const Interrupter& progress)
{
    const std::vector<const Leaf*> leaves = leavesOf(grid.tree());
    std::vector<Faces> parts(leaves.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, leaves.size(), 64),
                      [&](const tbb::blocked_range<std::size_t>& range) {
                          progress.check();
                          FloatGrid::ConstAccessor at = grid.getConstAccessor();
                          for (std::size_t n = range.begin(); n < range.end(); ++n)
                              parts[n] = facesOf(*leaves[n], at);
                      });
    Faces faces = facesOfTiles(grid);
    for (const Faces& part : parts) faces.join(part);
    return faces;
}

std::string openFacesText(const LevelSet& levelSet, const Faces& faces)
{
    return fmt::format(
        "grid '{}': inside meets outside without a band of distances between them, at {} of {} "
        "faces (first at voxel {}, {}, {})",
        levelSet.grid().getName(), faces.open, faces.all, faces.first.x(), faces.first.y(),
        faces.first.z());
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
    const float background = grid->background();
    const bool hasTiles = hasActiveTiles(grid->tree());
    Band band = measureBand(grid->tree(), background * (1 - kRounding), progress);
    const bool isFull = hasTiles || double(band.beyond) > kMaxBeyond * double(band.active);
    if (isFull && promised < kMinHalfWidth) // the values beyond it are the band
        band = measureBand(grid->tree(), std::numeric_limits<float>::max(), progress);
    const std::optional<double> measured = measuredWidth(band, h);
    progress.check();
    if (measured && *measured >= 1 &&
        (promised > *measured + kMaxExcess || (promised < kMinHalfWidth && isFull))) {
        notes.push_back(fmt::format("grid '{}': its background promises a band of {:.4g} voxels, "
                                    "and there are {:.4g}: the background was set to {:.4g}",
                                    grid->getName(), promised, *measured, *measured * h));
        return LevelSet(cutOff(*grid, float(*measured * h)));
    }
    return isFull || band.odd > 0 ? LevelSet(cutOff(*grid, background)) : given;
}

std::string missingBand(const LevelSet& levelSet, Interrupter* interrupter)
{
    const Faces faces = facesOf(levelSet.grid(), orSilent(interrupter));
    return faces.open > 0 ? openFacesText(levelSet, faces) : std::string();
}

void requireDistances(const LevelSet& levelSet, const std::string& cure, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    /// Median slopes of distances, as far as they may be filtered or moved elsewhere. [derived: an
    /// offset errs by half of its distance at most]
    constexpr double kMinSlope = 2.0 / 3, kMaxSlope = 1.5;
    /// Share of faces that may be beside inactive voxels. [tuned: given_level_set_test]
    constexpr double kMaxOpen = 0.1;
    const FloatGrid& grid = levelSet.grid();
    const double slope = medianSlope(grid, levelSet.voxelSize(), progress);
    if (!(slope >= kMinSlope && slope <= kMaxSlope))
        throw InputError(
            fmt::format("grid '{}': its values are not distances in world units: beside "
                        "the surface they change by {:.3g} per unit, where a distance "
                        "changes by 1. {}",
                        grid.getName(), slope, cure));
    const Faces faces = facesOf(grid, progress);
    if (double(faces.open) > kMaxOpen * double(faces.all))
        throw InputError(fmt::format("{}. {}", openFacesText(levelSet, faces), cure));
}

} // namespace mpuvdb
