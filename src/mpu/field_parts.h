// What a field of points is made of.
#pragma once
#include "mpu/fill/coarse_sign.h"
#include "mpu/octree/octree.h"
#include <mpuvdb/mpu_field.h>

#include <memory>

namespace mpuvdb
{

/// The parts of an MpuField; in memory, or mapped.
struct FieldParts {
    MpuSettings settings;
    std::shared_ptr<const VertexMesh> mesh; ///< the mesh whose vertices the points are, or null
    Vec3d frame = Vec3d::Zero();            ///< world position of the origin of local coordinates
    Box3d localBounds;                      ///< of the points
    std::unique_ptr<SortedPoints> points;
    Octree tree;
    std::unique_ptr<const CoarseSign> coarse; ///< null if the tree is complete
};

/// What is done with points at one position.
inline SortedPoints::Copies copiesFor(const MpuSettings& settings)
{
    return settings.interpolate ? SortedPoints::Copies::Merge : SortedPoints::Copies::Keep;
}

} // namespace mpuvdb
