// Leaves that contradict the coarse field lose their say.
#pragma once
#include "coarse_sign.h"
#include "mpu/octree/octree.h"

#include <vector>

namespace mpuvdb
{

/// The cells of the leaves that their data do not support.
std::vector<OctreeCell> unsupportedIn(OctreeDraft& tree);
/// The same below node @a root, the cell @a cell; appended to @a cells.
void addUnsupported(OctreeDraft& tree, std::uint32_t root, const OctreeCell& cell,
                    std::vector<OctreeCell>& cells);

/// Reduce the support of leaves whose distance at the center is inconsistent with the coarse field.
void vetoLeaves(OctreeDraft& tree, const CoarseSign& coarse);
/// The same for what is below node @a root, the cell @a cell; in the thread that calls.
void vetoLeaves(OctreeDraft& tree, std::uint32_t root, const OctreeCell& cell,
                const CoarseSign& coarse);

} // namespace mpuvdb
