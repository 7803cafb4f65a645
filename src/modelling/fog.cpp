// Level sets as densities: as openvdb::tools::sdfToFogVolume, but interruptible.
#include <mpuvdb/interrupter.h>
#include <mpuvdb/operations.h>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <memory>
#include <vector>

namespace mpuvdb
{
namespace
{

using openvdb::FloatGrid;
using openvdb::FloatTree;
using Leaf = FloatTree::LeafNodeType;
using Leaves = std::vector<const Leaf*>;
using Range = tbb::blocked_range<std::size_t>;

/// Calls @a visit with the level, a voxel and the value of each tile.
template <typename Visit>
void forEachTile(const FloatTree& tree, Interrupter& progress, const Visit& visit)
{
    auto tile = tree.cbeginValueAll();
    tile.setMaxDepth(FloatTree::ValueAllCIter::LEAF_DEPTH - 1);
    for (std::size_t n = 0; tile; ++tile, ++n) {
        if (n % 4096 == 0) progress.check();
        visit(tile.getLevel(), tile.getCoord(), *tile);
    }
}

/// The depth of the solid's deepest voxel or tile, world units; 0 without any.
float depthOf(const FloatTree& tree, const Leaves& leaves, Interrupter& progress)
{
    float deepest = 0;
    forEachTile(tree, progress, [&](openvdb::Index, const openvdb::Coord&, float value) {
        deepest = std::min(deepest, value);
    });
    deepest = tbb::parallel_reduce(
        Range(0, leaves.size(), 64), deepest,
        [&](const Range& range, float least) {
            progress.check();
            for (std::size_t n = range.begin(); n != range.end(); ++n) {
                const float* values = leaves[n]->buffer().data();
                least = std::min(least, *std::min_element(values, values + Leaf::SIZE));
            }
            return least;
        },
        [](float a, float b) { return std::min(a, b); });
    return -deepest;
}

/// The densities of a leaf, 1 at @a depth; null if all are 0.
std::unique_ptr<Leaf> densities(const Leaf& leaf, float depth)
{
    auto dense = std::make_unique<Leaf>(leaf.origin(), 0.0f);
    const float* values = leaf.buffer().data();
    for (openvdb::Index n = 0; n < Leaf::SIZE; ++n)
        if (values[n] < 0) dense->setValueOn(n, -values[n] / depth);
    return dense->isEmpty() ? nullptr : std::move(dense);
}

} // namespace

FloatGrid::Ptr toFog(const LevelSet& levelSet, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    const FloatTree& tree = levelSet.grid().tree();
    Leaves leaves;
    tree.getNodes(leaves);
    progress.beginStage("fog", double(std::max<std::size_t>(leaves.size(), 1)));
    const float depth = std::min(levelSet.grid().background(), depthOf(tree, leaves, progress));
    std::vector<std::unique_ptr<Leaf>> dense(leaves.size());
    tbb::parallel_for(Range(0, leaves.size(), 64), [&](const Range& range) {
        for (std::size_t n = range.begin(); n != range.end(); ++n)
            dense[n] = densities(*leaves[n], depth);
        progress.advance(double(range.size()));
    });
    const auto fogTree = std::make_shared<FloatTree>(0.0f);
    forEachTile(tree, progress, [&](openvdb::Index level, const openvdb::Coord& at, float value) {
        if (value < 0) fogTree->addTile(level, at, 1.0f, true);
    });
    for (std::size_t n = 0; n < dense.size(); ++n) {
        if (n % 1024 == 0) progress.check();
        if (dense[n]) fogTree->addLeaf(dense[n].release());
    }
    FloatGrid::Ptr fog = FloatGrid::create(fogTree);
    fog->setTransform(levelSet.grid().transform().copy());
    fog->insertMeta(levelSet.grid());
    fog->setGridClass(openvdb::GRID_FOG_VOLUME);
    fog->setName("density");
    progress.endStage();
    return fog;
}

} // namespace mpuvdb
