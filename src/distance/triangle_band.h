// The voxels near a mesh, and how far it is from them.
#pragma once
#include "spatial/triangle_tree.h"

#include <memory>
#include <openvdb/openvdb.h>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// The triangles of a mesh, and where voxels are among them.
struct PlacedTriangles {
    const TriangleTree& tree;
    Vec3d frame; ///< world position that the tree's corners count from
    Vec3d shift; ///< of voxel (0,0,0) from the frame
    double voxelSize;

    /// A place in voxels, as the tree has it.
    Vec3d place(const Vec3d& voxels) const { return voxelSize * voxels + shift; }
    /// The other way round.
    Vec3d voxels(const Vec3f& place) const { return (place.cast<double>() - shift) / voxelSize; }
};

/// Leaves of all voxels nearer than @a reach (voxels) to any triangle, sorted by origin: these are
/// active and hold their distance, exact, in world units, negative behind the triangles; the others
/// hold reach. Behind is what the mean of the nearest triangles' normals says, each by the angle
/// that it has at the nearest place: where the triangles bound a solid and face outward, that is
/// inside [Baerentzen05]. @throws Interrupted
std::vector<std::unique_ptr<openvdb::FloatTree::LeafNodeType>>
leavesNear(const PlacedTriangles& triangles, double reach, Interrupter& progress);

} // namespace mpuvdb
