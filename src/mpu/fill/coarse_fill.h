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

/// What bends the function at the nodes of a halved grid, per step there.
struct Curvature {
    std::vector<float> concave;    ///< sum of principal curvatures of concave data, at most 0
    std::vector<float> divergence; ///< of the data's normals
};

/// The curvature of concave data, extended beyond them.
/// @param data  with normals. @param border  values on the grid's box; other nodes are not read.
std::vector<float> spreadConcavity(const NodeGrid& grid, const NodeData& data,
                                   const std::vector<float>& border, Interrupter& progress);

/// The divergence of the data's normals, extended beyond them.
/// @param data  with normals.
std::vector<float> spreadDivergence(const NodeGrid& grid, const NodeData& data,
                                    Interrupter& progress);

/// Values for the box of a grid that holds all data, node steps.
/// @param distance  from the nodes to the nearest data, node steps.
std::vector<float> outsideBorder(std::vector<float> distance);

/// The function at every node, node steps, negative inside. Far from data only its sign and the
/// direction of its gradient are meaningful.
/// @param curvature  at the nodes of halved(@a grid).
/// @param border  values on the grid's box; other nodes are not read.
std::vector<float> fillBetween(const NodeGrid& grid, NodeData data, const Curvature& curvature,
                               const std::vector<float>& border, Interrupter& progress);

} // namespace mpuvdb
