#include <mpuvdb/attribute_grids.h>

#include "surface_places.h"

#include <mpuvdb/error.h>
#include <mpuvdb/progress.h>

#include <fmt/format.h>
#include <openvdb/tree/LeafManager.h>

#include <map>
#include <numeric>
#include <set>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

using openvdb::FloatTree;
using openvdb::Vec3STree;
using Leaf = FloatTree::LeafNodeType;

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

    /// Give the voxels of @a leaf what there is from @a next on in turn. Returns what is left.
    const float* fill(const Leaf& leaf, const float* next) const
    {
        openvdb::Vec3s* const color =
            colors ? colors->probeLeaf(leaf.origin())->buffer().data() : nullptr;
        std::vector<float*> into;
        for (const FloatTree::Ptr& tree : scalars)
            into.push_back(tree->probeLeaf(leaf.origin())->buffer().data());
        for (auto voxel = leaf.valueMask().beginOn(); voxel; ++voxel) {
            if (color) {
                color[voxel.pos()] = openvdb::Vec3s(next);
                next += 3;
            }
            for (float* const scalar : into) scalar[voxel.pos()] = *next++;
        }
        return next;
    }
};

/// Leaves in one cube of space, whose places are near each other.
using LeafGroup = std::vector<const Leaf*>;

std::vector<LeafGroup> groupsOf(const openvdb::tree::LeafManager<const FloatTree>& leaves)
{
    constexpr int kEdgeBits = 5; ///< 32 voxels: few places lie outside of the cube
    std::map<openvdb::Coord, LeafGroup> groups;
    for (std::size_t n = 0; n < leaves.leafCount(); ++n)
        groups[leaves.leaf(n).origin() >> kEdgeBits].push_back(&leaves.leaf(n));
    std::vector<LeafGroup> result;
    result.reserve(groups.size());
    for (auto& [cube, group] : groups) result.push_back(std::move(group));
    return result;
}

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
    const std::vector<LeafGroup> groups = groupsOf(leaves);
    tbb::parallel_for(std::size_t(0), groups.size(), [&](std::size_t n) {
        std::vector<SurfacePlace> places;
        places.reserve(std::accumulate(
            groups[n].begin(), groups[n].end(), std::size_t(0),
            [](std::size_t sum, const Leaf* leaf) { return sum + leaf->onVoxelCount(); }));
        SurfacePlaces band(surface, lattice);
        for (const Leaf* const leaf : groups[n]) band.append(*leaf, 1, places);
        std::vector<float> values;
        attributes.evaluate(places, values);
        const float* next = values.data();
        for (const Leaf* const leaf : groups[n]) next = trees.fill(*leaf, next);
        progress.advance(double(groups[n].size()));
    });
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
