// The voxels near a mesh with their distances from it.
#pragma once
#include "spatial/triangle_tree.h"

#include <memory>
#include <openvdb/openvdb.h>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// The triangles of a mesh, and the transform between voxels and them.
struct PlacedTriangles {
    const TriangleTree& tree;
    Vec3d frame; ///< world position that is the origin of the tree's corners
    Vec3d shift; ///< of voxel (0,0,0) from the frame
    double voxelSize;

    /// The place in the tree's coordinates of a place in voxels.
    Vec3d place(const Vec3d& voxels) const { return voxelSize * voxels + shift; }
    /// The place in voxels of a place in the tree's coordinates.
    Vec3d voxels(const Vec3f& place) const { return (place.cast<double>() - shift) / voxelSize; }
};

/// Leaves of all voxels nearer than @a reach (voxels) to any triangle, sorted by origin. These are
/// active with their exact distance, world units, negative behind the triangles; the others have
/// the reach. Behind is meant by the angle-weighted mean of the nearest triangles' normals: where
/// the triangles bound a solid and face outward, that is inside [Baerentzen05]. @throws
/// Interrupted.
std::vector<std::unique_ptr<openvdb::FloatTree::LeafNodeType>>
leavesNear(const PlacedTriangles& triangles, double reach, Interrupter& progress);

} // namespace mpuvdb
