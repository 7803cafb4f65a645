// Projection of a band's voxels to the zero set.
#pragma once
#include <mpuvdb/level_set.h>

#include <memory>

namespace mpuvdb
{

/// Projects voxels leaf by leaf. For one thread.
class SurfacePlaces
{
public:
    /// @param surface  a level set, which has to outlive this.
    SurfacePlaces(const openvdb::FloatGrid& surface, const Lattice& lattice);
    ~SurfacePlaces();

    /// Set @a places to the nearest places on the zero set of the active voxels of @a leaf, in
    /// order. @a leaf belongs to the band, or to a tree of the same voxels.
    /// @param projections  largest number of steps to the zero set. After one, a place outside an
    /// edge may lie up to a voxel off it.
    void find(const openvdb::FloatTree::LeafNodeType& leaf, int projections, SurfacePlace* places);

private:
    class Band;
    std::unique_ptr<Band> mBand;
    Lattice mLattice;
};

} // namespace mpuvdb
