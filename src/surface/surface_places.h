// Where on the zero set the voxels of a band belong.
#pragma once
#include <mpuvdb/level_set.h>

#include <memory>
#include <vector>

namespace mpuvdb
{

/// Finds them, leaf by leaf; scratch memory of one thread.
class SurfacePlaces
{
public:
    /// @param surface  a level set, which has to outlive this.
    SurfacePlaces(const openvdb::FloatGrid& surface, const Lattice& lattice);
    ~SurfacePlaces();

    /// For each active voxel of @a leaf, in order, append the place on the zero set that is nearest
    /// to it. @a leaf is one of the band's, or of a tree of the same voxels.
    /// @param projections  at most so many times a place is drawn to the zero set. Once is enough
    /// for what does not change within a voxel; outside of an edge the place may lie as far off it.
    void append(const openvdb::FloatTree::LeafNodeType& leaf, int projections,
                std::vector<SurfacePlace>& places);

private:
    class Band;
    std::unique_ptr<Band> mBand;
    Lattice mLattice;
};

} // namespace mpuvdb
