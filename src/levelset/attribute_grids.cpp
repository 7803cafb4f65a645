#include <mpuvdb/attribute_grids.h>

#include "surface_places.h"

#include <mpuvdb/error.h>
#include <mpuvdb/progress.h>

#include <fmt/format.h>
#include <openvdb/tree/LeafManager.h>

#include <set>

namespace mpuvdb
{
namespace
{

using openvdb::FloatTree;
using openvdb::Vec3STree;

void demandNames(const LevelSet& levelSet, const SurfaceAttributes& attributes)
{
    std::set<std::string> names = {levelSet.grid().getName(), kCoverageName, kColorName};
    for (const std::string& name : attributes.scalarNames())
        if (!names.insert(name).second)
            throw UsageError(fmt::format("an attribute cannot be called '{}': another grid is, or "
                                         "it is named twice",
                                         name));
}

template <class Tree>
openvdb::GridBase::Ptr gridOf(const typename Tree::Ptr& tree, const LevelSet& levelSet,
                              const std::string& name)
{
    auto grid = openvdb::Grid<Tree>::create(tree);
    grid->setTransform(levelSet.grid().transform().copy());
    grid->setGridClass(openvdb::GRID_UNKNOWN);
    grid->setName(name);
    return grid;
}

/// The trees that are filled; the colours' is null without colours.
struct Trees {
    Vec3STree::Ptr colors;
    std::vector<FloatTree::Ptr> scalars;

    Trees(const FloatTree& band, const SurfaceAttributes& attributes)
    {
        if (attributes.hasColors())
            colors = std::make_shared<Vec3STree>(band, openvdb::Vec3s(0), openvdb::TopologyCopy());
        for (std::size_t n = 0; n < attributes.scalarNames().size(); ++n)
            scalars.push_back(std::make_shared<FloatTree>(band, 0.0f, openvdb::TopologyCopy()));
    }

    /// Give the voxels of @a leaf what @a values hold in turn.
    void fill(const FloatTree::LeafNodeType& leaf, const std::vector<float>& values) const
    {
        const float* next = values.data();
        Vec3STree::LeafNodeType* const color = colors ? colors->probeLeaf(leaf.origin()) : nullptr;
        std::vector<FloatTree::LeafNodeType*> into;
        for (const FloatTree::Ptr& tree : scalars) into.push_back(tree->probeLeaf(leaf.origin()));
        for (auto voxel = leaf.cbeginValueOn(); voxel; ++voxel) {
            if (color) {
                color->setValueOnly(voxel.pos(), openvdb::Vec3s(next[0], next[1], next[2]));
                next += 3;
            }
            for (FloatTree::LeafNodeType* const scalar : into)
                scalar->setValueOnly(voxel.pos(), *next++);
        }
    }
};

} // namespace

std::vector<openvdb::GridBase::Ptr>
sampleAttributes(const LevelSet& levelSet, const SurfaceAttributes& attributes, Progress& progress)
{
    demandNames(levelSet, attributes);
    const openvdb::FloatGrid& surface = levelSet.grid();
    const Lattice lattice = levelSet.lattice();
    openvdb::tree::LeafManager<const FloatTree> leaves(surface.tree());
    const Trees trees(surface.tree(), attributes);
    progress.beginStage("attributes", double(leaves.leafCount()));
    leaves.foreach (
        [&](const FloatTree::LeafNodeType& leaf, std::size_t) {
            std::vector<float> values;
            attributes.evaluate(surfacePlaces(surface, lattice, leaf), values);
            trees.fill(leaf, values);
            progress.advance();
        },
        /*threaded=*/true, /*grainsize=*/16);
    std::vector<openvdb::GridBase::Ptr> grids;
    if (trees.colors) {
        grids.push_back(gridOf<Vec3STree>(trees.colors, levelSet, kColorName));
        grids.back()->setSaveFloatAsHalf(true);
        grids.back()->insertMeta("mpuvdb:quantity",
                                 openvdb::StringMetadata("linear red, green and blue"));
    }
    for (std::size_t n = 0; n < trees.scalars.size(); ++n)
        grids.push_back(gridOf<FloatTree>(trees.scalars[n], levelSet, attributes.scalarNames()[n]));
    progress.endStage();
    return grids;
}

} // namespace mpuvdb
