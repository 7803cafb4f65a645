#include <mpuvdb/attribute_grids.h>

#include "attribute_values.h"
#include <mpuvdb/interrupter.h>

#include <memory>
#include <openvdb/tree/ValueAccessor.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

using openvdb::FloatTree;
using openvdb::Vec3STree;

/// New leaves of one attribute's tree.
template <class Tree>
class Made
{
public:
    using Value = typename Tree::ValueType;
    using Node = typename Tree::LeafNodeType;

    /// The values of a new leaf like @a leaf, all zero.
    Value* addLike(const FloatTree::LeafNodeType& leaf)
    {
        mLeaves.push_back(
            std::make_unique<Node>(leaf, openvdb::zeroVal<Value>(), openvdb::TopologyCopy()));
        return mLeaves.back()->buffer().data();
    }
    void moveTo(openvdb::GridBase& grid)
    {
        openvdb::tree::ValueAccessor<Tree> to(static_cast<openvdb::Grid<Tree>&>(grid).tree());
        for (std::unique_ptr<Node>& leaf : mLeaves) to.addLeaf(leaf.release());
    }

private:
    std::vector<std::unique_ptr<Node>> mLeaves;
};

/// New leaves of all attributes' trees.
class MadeLeaves
{
public:
    explicit MadeLeaves(const SurfaceAttributes& attributes)
        : mHasColors(attributes.hasColors()), mScalars(attributes.scalarNames().size())
    {
    }

    /// @param values  see AttributeValues::forEach().
    void addLike(const FloatTree::LeafNodeType& leaf, const float* values)
    {
        openvdb::Vec3s* const color = mHasColors ? mColors.addLike(leaf) : nullptr;
        std::vector<float*> scalars;
        for (Made<FloatTree>& scalar : mScalars) scalars.push_back(scalar.addLike(leaf));
        for (auto voxel = leaf.valueMask().beginOn(); voxel; ++voxel) {
            if (color) {
                color[voxel.pos()] = openvdb::Vec3s(values);
                values += 3;
            }
            for (float* const scalar : scalars) scalar[voxel.pos()] = *values++;
        }
    }
    void moveTo(const std::vector<openvdb::GridBase::Ptr>& grids)
    {
        auto grid = grids.begin();
        if (mHasColors) mColors.moveTo(**grid++);
        for (Made<FloatTree>& scalar : mScalars) scalar.moveTo(**grid++);
    }

private:
    bool mHasColors;
    Made<Vec3STree> mColors;
    std::vector<Made<FloatTree>> mScalars;
};

} // namespace

std::vector<openvdb::GridBase::Ptr> sampleAttributes(const LevelSet& levelSet,
                                                     const SurfaceAttributes& attributes,
                                                     Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    std::vector<openvdb::GridBase::Ptr> grids = attributeGridHeads(levelSet, attributes);
    const std::vector<LeafGroup> groups = leafGroups(levelSet.grid().tree()).all;
    progress.beginStage("attributes", double(groups.size()));
    std::vector<MadeLeaves> made;
    for (std::size_t n = 0; n < groups.size(); ++n) made.emplace_back(attributes);
    tbb::enumerable_thread_specific<AttributeValues> evaluators(
        [&] { return AttributeValues(levelSet, attributes); });
    tbb::parallel_for(std::size_t(0), groups.size(), [&](std::size_t n) {
        evaluators.local().forEach(groups[n], [&](const auto& leaf, const float* values) {
            made[n].addLike(leaf, values);
        });
        progress.advance();
    });
    for (MadeLeaves& some : made) some.moveTo(grids);
    progress.endStage();
    return grids;
}

} // namespace mpuvdb
