// Isosurfaces of grids of any class as level sets.
#include "grid/transform_lattice.h"
#include <mpuvdb/distances.h>
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/sampling.h>

#include <cmath>
#include <fmt/format.h>
#include <memory>
#include <openvdb/tools/Count.h>
#include <openvdb/tools/Morphology.h>
#include <vector>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using openvdb::FloatGrid;
using openvdb::FloatTree;
using Leaf = FloatTree::LeafNodeType;

/// Peak memory for a tile's face of 8 x 8 voxels, bytes. [tuned: measured on cubes of tiles]
constexpr std::uint64_t kBytesPerFace = 28000;

/// Maps a value to its excess outside: positive outside, negative inside.
struct Outside {
    float value, sign;
    float operator()(float v) const { return sign * (v - value); }
};

/// Call visit(in, out) with a voxel of each side for every face of 8 x 8 voxels between the tile in
/// @a box, which is inside, and an outside tile.
template <typename F>
void forEachOpenFace(const openvdb::CoordBBox& box, const FloatTree& tree, F&& visit)
{
    for (int face = 0; face < 6; ++face) {
        const int axis = face / 2, u = (axis + 1) % 3, v = (axis + 2) % 3;
        Coord in, out;
        in[axis] = face % 2 ? box.max()[axis] : box.min()[axis];
        out[axis] = in[axis] + (face % 2 ? 1 : -1);
        for (in[u] = box.min()[u]; in[u] <= box.max()[u]; in[u] += kBlockDim)
            for (in[v] = box.min()[v]; in[v] <= box.max()[v]; in[v] += kBlockDim) {
                out[u] = in[u];
                out[v] = in[v];
                if (!tree.probeConstLeaf(out) && !(tree.getValue(out) < 0)) visit(in, out);
            }
    }
}

/// @throws LimitError if the tiles' surface needs more than @a maxBytes.
void requireMemory(const std::vector<openvdb::CoordBBox>& tiles, const FloatTree& tree,
                   std::uint64_t maxBytes, Interrupter& progress)
{
    std::uint64_t faces = 0;
    for (const openvdb::CoordBBox& box : tiles) {
        progress.check();
        forEachOpenFace(box, tree, [&](const Coord&, const Coord&) { ++faces; });
    }
    const std::uint64_t bytes = faces * kBytesPerFace;
    if (maxBytes == 0 || bytes <= maxBytes) return;
    throw LimitError(fmt::format("the surface of the grid's tiles, {} faces of {} x {} voxels, "
                                 "needs about {:.0f} MB, more than the {:.0f} MB that are left: "
                                 "raise --max-memory, or use larger voxels",
                                 faces, kBlockDim, kBlockDim, double(bytes) / 1e6,
                                 double(maxBytes) / 1e6));
}

/// The values of @a grid mapped by @a outside; voxels of and beside leaves are active.
FloatTree::Ptr outward(const FloatGrid& grid, const Outside& outside, std::uint64_t maxBytes,
                       Interrupter& progress)
{
    auto tree = std::make_shared<FloatTree>(outside(grid.background()));
    std::vector<openvdb::CoordBBox> inside;
    auto tile = grid.tree().cbeginValueAll();
    for (tile.setMaxDepth(FloatTree::ValueAllCIter::LEAF_DEPTH - 1); tile; ++tile) {
        if (!(outside(*tile) < 0)) continue;
        tree->addTile(tile.getLevel(), tile.getCoord(), outside(*tile), false);
        inside.push_back(tile.getBoundingBox());
    }
    for (auto from = grid.tree().cbeginLeaf(); from; ++from) {
        progress.check();
        auto leaf = std::make_unique<Leaf>(from->origin(), 0.0f, true);
        for (openvdb::Index n = 0; n < Leaf::SIZE; ++n)
            leaf->setValueOnly(n, outside(from->getValue(n)));
        tree->addLeaf(leaf.release());
    }
    requireMemory(inside, *tree, maxBytes, progress);
    for (const openvdb::CoordBBox& box : inside) {
        progress.check();
        // The zero crossing has to lie between active voxels.
        forEachOpenFace(box, *tree, [&](const Coord& in, const Coord& out) {
            tree->touchLeaf(in)->setValuesOn();
            tree->touchLeaf(out)->setValuesOn();
        });
    }
    openvdb::tools::dilateActiveValues(*tree, 1, openvdb::tools::NN_FACE,
                                       openvdb::tools::IGNORE_TILES);
    return tree;
}

/// A hint for level sets, whose inside is below: text to append to an error, or none.
std::string hintFor(const FloatGrid& grid, Inside inside)
{
    const bool isSigned = openvdb::tools::minMax(grid.tree()).min() < 0;
    return inside == Inside::Above && isSigned
               ? ". If these are distances, inside is below: --value 0 --inside below"
               : "";
}

} // namespace

LevelSet isosurface(const FloatGrid& grid, double value, Inside inside, double halfWidth,
                    std::uint64_t maxBytes, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    requireUniformVoxels(grid);
    requireFinite(grid);
    const bool above = inside == Inside::Above;
    const Outside outside{float(value), above ? -1.0f : 1.0f};
    if (!(outside(grid.background()) > 0))
        throw UsageError(fmt::format("grid '{}': its background is {:g}, and must be outside: the "
                                     "value is {:g}, and has to be {} that{}",
                                     grid.getName(), grid.background(), value,
                                     above ? "above" : "below", hintFor(grid, inside)));
    progress.beginStage("isosurface");
    const FloatGrid::Ptr implicit = FloatGrid::create(outward(grid, outside, maxBytes, progress));
    implicit->setTransform(grid.transform().copy());
    implicit->setGridClass(openvdb::GRID_LEVEL_SET);
    implicit->setName("surface");
    LevelSet made = redistance(*implicit, halfWidth, &progress);
    progress.endStage();
    if (made.grid().empty()) {
        const auto range = openvdb::tools::minMax(grid.tree());
        throw InputError(
            fmt::format("grid '{}': nothing is {} {:g}: its {} value is {:g}. Choose a "
                        "{} one{}",
                        grid.getName(), above ? "above" : "below", value,
                        above ? "largest" : "smallest", above ? range.max() : range.min(),
                        above ? "smaller" : "larger", hintFor(grid, inside)));
    }
    return made;
}

} // namespace mpuvdb
