// Faces between inside and outside beside which there are no distances.
#include <mpuvdb/given_level_set.h>

#include "leaf_words.h"
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <fmt/format.h>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using openvdb::FloatGrid;
using openvdb::FloatTree;

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
Faces facesOf(const FloatLeaf& leaf, FloatGrid::ConstAccessor& at)
{
    Faces faces;
    const SignWords inside = insideOf(leaf), on = activeOf(leaf);
    const Coord origin = leaf.origin();
    for (int x = 0; x <= kLastInLeaf; ++x)
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
    for (const Toward& to : kTowardFaces) {
        Coord beyond = origin;
        beyond[to.axis] += to.step * int(FloatLeaf::DIM);
        const FloatLeaf* const beside = at.probeConstLeaf(beyond);
        if (beside && to.step < 0) continue; // that leaf counts them
        const float tile = beside ? 0 : at.getValue(beyond);
        const bool isTileOn = !beside && at.isValueOn(beyond);
        const int u = (to.axis + 1) % 3, v = (to.axis + 2) % 3;
        Coord own, other;
        own[to.axis] = to.step > 0 ? kLastInLeaf : 0;
        other[to.axis] = kLastInLeaf - own[to.axis];
        for (own[u] = 0; own[u] <= kLastInLeaf; ++own[u])
            for (own[v] = 0; own[v] <= kLastInLeaf; ++own[v]) {
                other[u] = own[u];
                other[v] = own[v];
                const openvdb::Index i = FloatLeaf::coordToOffset(own),
                                     j = FloatLeaf::coordToOffset(other);
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
    std::vector<const FloatLeaf*> leaves;
    grid.tree().getNodes(leaves);
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

std::string missingBand(const LevelSet& levelSet, Interrupter* interrupter)
{
    const Faces faces = facesOf(levelSet.grid(), orSilent(interrupter));
    return faces.open > 0 ? openFacesText(levelSet, faces) : std::string();
}

std::string requireBand(const LevelSet& levelSet, const std::string& cure, Interrupter* interrupter)
{
    /// Share of faces that may be beside inactive voxels. [tuned: given_level_set_test]
    constexpr double kMaxOpen = 0.1;
    const Faces faces = facesOf(levelSet.grid(), orSilent(interrupter));
    if (double(faces.open) > kMaxOpen * double(faces.all))
        throw InputError(fmt::format("{}. {}", openFacesText(levelSet, faces), cure));
    return faces.open > 0 ? openFacesText(levelSet, faces) : std::string();
}

} // namespace mpuvdb
