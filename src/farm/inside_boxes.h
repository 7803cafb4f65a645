// What of a solid lies between its tiles, far from its surface.
#pragma once
#include "parted_grid.h"

#include <string>

namespace mpuvdb
{

class Interrupter;

/// Boxes without leaves that are inside, by the part (see PartedGrid::parts()) in whose file they
/// shall be. OpenVDB's operations take a node of the tree without active voxels to be of one sign,
/// so each box lies in one node below the root (4096 voxels), and goes to a part with leaves in
/// that node; where no part has any, the node is inside as a whole, and goes to one part.
std::map<openvdb::Coord, std::vector<openvdb::CoordBBox>>
insideBoxes(const PartedGrid& grid, const std::string& prefix, Interrupter& progress);

} // namespace mpuvdb
