#include "attribute_values.h"

#include <mpuvdb/error.h>
#include <mpuvdb/sampling.h>

#include <fmt/format.h>
#include <map>
#include <set>

namespace mpuvdb
{
namespace
{

using openvdb::FloatTree;
using openvdb::GridBase;

void requireUniqueNames(const LevelSet& levelSet, const SurfaceAttributes& attributes)
{
    std::set<std::string> names = {levelSet.grid().getName(), kCoverageName, kColorName};
    for (const std::string& name : attributes.scalarNames())
        if (!names.insert(name).second)
            throw UsageError(fmt::format(
                "attribute '{}': another grid or attribute has that name. Rename it", name));
}

template <class GridT>
GridBase::Ptr headOf(const LevelSet& levelSet, const std::string& name)
{
    auto grid = GridT::create();
    grid->setTransform(levelSet.grid().transform().copy());
    grid->setGridClass(openvdb::GRID_UNKNOWN);
    grid->setName(name);
    return grid;
}

} // namespace

LeafGroups leafGroups(const FloatTree& band)
{
    /// Binary logarithm of the cube's edge, voxels. [free: time]
    constexpr int kEdgeBits = 5;
    std::map<openvdb::Coord, std::uint32_t> groupOf; // of a cube
    LeafGroups result;
    for (auto leaf = band.cbeginLeaf(); leaf; ++leaf) {
        const auto [at, isNew] =
            groupOf.emplace(leaf->origin() >> kEdgeBits, std::uint32_t(result.all.size()));
        if (isNew) result.all.emplace_back();
        result.all[at->second].push_back(&*leaf);
        result.ofLeaves.push_back(at->second);
    }
    return result;
}

std::vector<GridBase::Ptr> attributeGridHeads(const LevelSet& levelSet,
                                              const SurfaceAttributes& attributes)
{
    requireUniqueNames(levelSet, attributes);
    std::vector<GridBase::Ptr> grids;
    if (attributes.hasColors()) {
        grids.push_back(headOf<openvdb::Vec3SGrid>(levelSet, kColorName));
        grids.back()->setSaveFloatAsHalf(true);
        grids.back()->insertMeta("mpuvdb:quantity",
                                 openvdb::StringMetadata("linear red, green and blue"));
    }
    for (const std::string& name : attributes.scalarNames())
        grids.push_back(headOf<openvdb::FloatGrid>(levelSet, name));
    return grids;
}

AttributeValues::AttributeValues(const LevelSet& levelSet, const SurfaceAttributes& attributes)
    : mBand(levelSet.grid(), levelSet.lattice()), mAttributes(attributes),
      mChannels((attributes.hasColors() ? 3 : 0) + attributes.scalarNames().size())
{
}

void AttributeValues::evaluate(const LeafGroup& group)
{
    std::size_t count = 0;
    for (const Leaf* const leaf : group) count += leaf->onVoxelCount();
    mPlaces.resize(count);
    SurfacePlace* place = mPlaces.data();
    for (const Leaf* const leaf : group) {
        mBand.find(*leaf, 1, place);
        place += leaf->onVoxelCount();
    }
    mAttributes.evaluate(mPlaces, mValues);
}

} // namespace mpuvdb
