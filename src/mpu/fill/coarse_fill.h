// A signed function on a coarse grid: the distance near data, elsewhere a continuation of their
// shape.
#pragma once
#include "multigrid.h"

#include <array>
#include <vector>

namespace mpuvdb
{

/// Data at the nodes near them.
struct NodeData {
    NodeData(const NodeGrid& grid, bool withNormals);

    std::vector<float> weight;                ///< 0 where there are none
    std::vector<float> distance;              ///< signed, node steps
    std::array<std::vector<float>, 3> normal; ///< unit; empty without normals
};

/// The grid of every other node.
NodeGrid halved(const NodeGrid& grid);

/// The curvature of the function at every node, per node step: that of the data at their rims,
/// extended to where there are none.
/// @param data  with normals.
std::vector<float> spreadCurvature(const NodeGrid& grid, const NodeData& data,
                                   Interrupter& progress);

/// The function at every node, node steps, negative inside. Far from data only its sign and the
/// direction of its gradient are meaningful.
/// @param curvature  at the nodes of halved(@a grid), per step there.
/// @param borderDistance  distance from the nodes of the grid's box to the nearest data, node
///                        steps; other nodes are not read.
std::vector<float> fillBetween(const NodeGrid& grid, NodeData data,
                               const std::vector<float>& curvature,
                               std::vector<float> borderDistance, Interrupter& progress);

} // namespace mpuvdb
