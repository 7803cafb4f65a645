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

/// The leaves of @a band, which they belong to.
std::vector<LeafGroup> leafGroups(const openvdb::FloatTree& band);

/// The grids of @a attributes beside @a levelSet, without voxels: colors first, then scalars.
/// @throws UsageError if two grids would have one name.
std::vector<openvdb::GridBase::Ptr> attributeGridHeads(const LevelSet& levelSet,
                                                       const SurfaceAttributes& attributes);

/// Where the values of one leaf go, by voxel.
struct AttributeVoxels {
    openvdb::Vec3s* color = nullptr; ///< null without colors
    std::vector<float*> scalars;
};

/// Evaluates attributes on the active voxels of leaves. For one thread.
class AttributeValues
{
public:
    /// @param levelSet, attributes  have to outlive this.
    AttributeValues(const LevelSet& levelSet, const SurfaceAttributes& attributes);

    /// Call f(leaf, set) for each leaf of @a group: set(voxels) sets its active voxels.
    template <typename F>
    void forEach(const LeafGroup& group, const F& f)
    {
        evaluate(group);
        const float* next = mValues.data();
        for (const auto* const leaf : group)
            f(*leaf, [&](const AttributeVoxels& voxels) { next = set(*leaf, voxels, next); });
    }

private:
    using Leaf = openvdb::FloatTree::LeafNodeType;

    void evaluate(const LeafGroup& group);
    static const float* set(const Leaf& leaf, const AttributeVoxels& voxels, const float* next);

    SurfacePlaces mBand;
    const SurfaceAttributes& mAttributes;
    std::vector<SurfacePlace> mPlaces;
    std::vector<float> mValues; ///< voxel by voxel
};

} // namespace mpuvdb
