// The values of attributes on the voxels of a band, leaf by leaf.
#pragma once
#include "surface/surface_places.h"
#include <mpuvdb/surface_attributes.h>

#include <openvdb/openvdb.h>

#include <vector>

namespace mpuvdb
{

/// Leaves of a band in one cube of space: few places of their voxels lie outside of it.
using LeafGroup = std::vector<const openvdb::FloatTree::LeafNodeType*>;

struct LeafGroups {
    std::vector<LeafGroup> all;
    std::vector<std::uint32_t> ofLeaves; ///< the group of each of the band's leaves, in its order
};

/// The leaves of @a band, which they belong to; those of a group in the band's order.
LeafGroups leafGroups(const openvdb::FloatTree& band);

/// The grids of @a attributes beside @a levelSet, without voxels: colors first, then scalars.
/// @throws UsageError if two grids would have one name.
std::vector<openvdb::GridBase::Ptr> attributeGridHeads(const LevelSet& levelSet,
                                                       const SurfaceAttributes& attributes);

/// Evaluates attributes on the active voxels of leaves. For one thread.
class AttributeValues
{
public:
    /// @param levelSet, attributes  have to outlive this.
    AttributeValues(const LevelSet& levelSet, const SurfaceAttributes& attributes);

    /// Call f(leaf, values) for each leaf of @a group, with the values of its active voxels, one
    /// after the other: of each, red, green and blue if there are colors, and the scalars.
    template <typename F>
    void forEach(const LeafGroup& group, const F& f)
    {
        evaluate(group);
        const float* values = mValues.data();
        for (const auto* const leaf : group) {
            f(*leaf, values);
            values += leaf->onVoxelCount() * mChannels;
        }
    }

private:
    using Leaf = openvdb::FloatTree::LeafNodeType;

    void evaluate(const LeafGroup& group);

    SurfacePlaces mBand;
    const SurfaceAttributes& mAttributes;
    std::vector<SurfacePlace> mPlaces;
    std::vector<float> mValues; ///< voxel by voxel
    std::size_t mChannels;      ///< of a voxel
};

} // namespace mpuvdb
