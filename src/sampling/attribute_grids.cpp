#include <mpuvdb/attribute_grids.h>

#include "surface/surface_places.h"
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/sampling.h>

#include <fmt/format.h>
#include <map>
#include <openvdb/tree/LeafManager.h>
#include <set>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

using openvdb::FloatTree;
using openvdb::Vec3STree;
using Leaf = FloatTree::LeafNodeType;

void requireUniqueNames(const LevelSet& levelSet, const SurfaceAttributes& attributes)
{
    std::set<std::string> names = {levelSet.grid().getName(), kCoverageName, kColorName};
    for (const std::string& name : attributes.scalarNames())
        if (!names.insert(name).second)
            throw UsageError(fmt::format(
                "attribute '{}': another grid or attribute has that name. Rename it", name));
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

/// New leaves of one attribute's tree.
template <class Tree>
class Made
{
public:
    using Value = typename Tree::ValueType;
    using Node = typename Tree::LeafNodeType;

    /// The values of a new leaf like @a leaf, all zero.
    Value* addLike(const Leaf& leaf)
    {
        mLeaves.push_back(
            std::make_unique<Node>(leaf, openvdb::zeroVal<Value>(), openvdb::TopologyCopy()));
        return mLeaves.back()->buffer().data();
    }
    void moveTo(Tree& tree)
    {
        openvdb::tree::ValueAccessor<Tree> to(tree);
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

    /// Set the voxels of @a leaf to the values from @a next on. Returns the first unused value.
    const float* add(const Leaf& leaf, const float* next)
    {
        openvdb::Vec3s* const color = mHasColors ? mColors.addLike(leaf) : nullptr;
        std::vector<float*> into;
        for (Made<FloatTree>& scalar : mScalars) into.push_back(scalar.addLike(leaf));
        for (openvdb::Index word = 0; word < kBlockDim; ++word)
            for (auto left = leaf.valueMask().getWord<std::uint64_t>(word); left;
                 left &= left - 1) {
                const auto n = 64 * word + openvdb::Index(__builtin_ctzll(left));
                if (color) {
                    color[n] = openvdb::Vec3s(next);
                    next += 3;
                }
                for (float* const scalar : into) scalar[n] = *next++;
            }
        return next;
    }
    void moveTo(Vec3STree& colors, const std::vector<FloatTree::Ptr>& scalars)
    {
        mColors.moveTo(colors);
        for (std::size_t n = 0; n < scalars.size(); ++n) mScalars[n].moveTo(*scalars[n]);
    }

private:
    bool mHasColors;
    Made<Vec3STree> mColors;
    std::vector<Made<FloatTree>> mScalars;
};

/// The leaves in one cube of space.
using LeafGroup = std::vector<const Leaf*>;

std::vector<LeafGroup> groupsOf(const openvdb::tree::LeafManager<const FloatTree>& leaves)
{
    /// Binary logarithm of the cube's edge, voxels: few places lie outside of the cube. [free:
    /// time]
    constexpr int kEdgeBits = 5;
    std::map<openvdb::Coord, LeafGroup> groups;
    for (std::size_t n = 0; n < leaves.leafCount(); ++n)
        groups[leaves.leaf(n).origin() >> kEdgeBits].push_back(&leaves.leaf(n));
    std::vector<LeafGroup> result;
    result.reserve(groups.size());
    for (auto& [cube, group] : groups) result.push_back(std::move(group));
    return result;
}

/// The memory of one thread, kept from group to group.
struct Scratch {
    SurfacePlaces band;
    std::vector<SurfacePlace> places;
    std::vector<float> values;
};

} // namespace

std::vector<openvdb::GridBase::Ptr> sampleAttributes(const LevelSet& levelSet,
                                                     const SurfaceAttributes& attributes,
                                                     Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    requireUniqueNames(levelSet, attributes);
    const openvdb::FloatGrid& surface = levelSet.grid();
    const Lattice lattice = levelSet.lattice();
    openvdb::tree::LeafManager<const FloatTree> leaves(surface.tree());
    progress.beginStage("attributes", double(leaves.leafCount()));
    const std::vector<LeafGroup> groups = groupsOf(leaves);
    std::vector<MadeLeaves> made;
    for (std::size_t n = 0; n < groups.size(); ++n) made.emplace_back(attributes);
    tbb::enumerable_thread_specific<Scratch> scratch([&] {
        return Scratch{{surface, lattice}, {}, {}};
    });
    tbb::parallel_for(std::size_t(0), groups.size(), [&](std::size_t n) {
        auto& [band, places, values] = scratch.local();
        std::size_t count = 0;
        for (const Leaf* const leaf : groups[n]) count += leaf->onVoxelCount();
        places.resize(count);
        SurfacePlace* place = places.data();
        for (const Leaf* const leaf : groups[n]) {
            band.find(*leaf, 1, place);
            place += leaf->onVoxelCount();
        }
        attributes.evaluate(places, values);
        const float* next = values.data();
        for (const Leaf* const leaf : groups[n]) next = made[n].add(*leaf, next);
        progress.advance(double(groups[n].size()));
    });
    const auto colors = std::make_shared<Vec3STree>(openvdb::Vec3s(0));
    std::vector<FloatTree::Ptr> scalars;
    for (std::size_t n = 0; n < attributes.scalarNames().size(); ++n)
        scalars.push_back(std::make_shared<FloatTree>(0.0f));
    for (MadeLeaves& some : made) some.moveTo(*colors, scalars);
    std::vector<openvdb::GridBase::Ptr> grids;
    if (attributes.hasColors()) {
        grids.push_back(gridOf<Vec3STree>(colors, levelSet, kColorName));
        grids.back()->setSaveFloatAsHalf(true);
        grids.back()->insertMeta("mpuvdb:quantity",
                                 openvdb::StringMetadata("linear red, green and blue"));
    }
    for (std::size_t n = 0; n < scalars.size(); ++n)
        grids.push_back(gridOf<FloatTree>(scalars[n], levelSet, attributes.scalarNames()[n]));
    progress.endStage();
    return grids;
}

} // namespace mpuvdb
