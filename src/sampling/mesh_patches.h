// The patches of a mesh: which way they face, and which enclose nothing.
#pragma once
#include "oriented_triangles.h"

#include <cmath>
#include <vector>

namespace mpuvdb
{

/// The patches of a mesh: parts of its surface that are connected over edges.
struct MeshPatches {
    std::vector<std::uint32_t> patchOf; ///< by triangle
    /// By patch, the mean of the winding numbers on its two sides, weighted by area: 1/2 for the
    /// boundary of a solid, 0 for a surface that encloses nothing, 1 for one within a solid.
    std::vector<double> enclosed;
    /// By patch, whether it is an open surface with sides that are as deep inside, over most of its
    /// area: the mean there is nearer to a whole number than to a half.
    std::vector<std::uint8_t> isWall;
    std::uint64_t turned = 0; ///< patches that were turned

    /// Whether a patch is a wall outside of all solids.
    bool isSheet(std::uint32_t patch) const
    {
        return isWall[patch] && std::abs(enclosed[patch]) < 0.5;
    }
    /// Whether a patch is a wall within a solid.
    bool isInnerWall(std::uint32_t patch) const { return isWall[patch] && !isSheet(patch); }
};

/// Turn patches to face as those do whose rims run along theirs, within @a gap (world units), and
/// outward: so that the winding number is higher behind them than before them. Triangles turned are
/// added to @a triangles.turned. @throws Interrupted.
MeshPatches turnPatches(OrientedTriangles& triangles, double gap, Interrupter& progress);

} // namespace mpuvdb
