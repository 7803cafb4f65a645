// The patches of a mesh: which way they face, and which enclose nothing.
#pragma once
#include "oriented_triangles.h"

#include <vector>

namespace mpuvdb
{

/// The patches of a mesh: connected parts of its surface, and parts whose rims run along each
/// other.
struct MeshPatches {
    std::vector<std::uint32_t> patchOf; ///< by triangle
    /// By patch, the mean of the winding numbers on its two sides, weighted by area: 1/2 for a
    /// closed surface, and 0 for one that encloses nothing.
    std::vector<double> enclosed;
    std::uint64_t turned = 0; ///< patches that were turned

    /// Whether a patch is nearer to a surface that encloses nothing than to a closed one.
    bool isSheet(std::uint32_t patch) const
    {
        constexpr double kSheet = 0.25; // [derived: halfway between 0 and 1/2]
        return enclosed[patch] < kSheet && enclosed[patch] > -kSheet;
    }
};

/// Turn patches to face as those do whose rims run along theirs, within @a gap (world units), and
/// outward: so that the winding number is higher behind them than 1/2. Triangles turned are added
/// to @a triangles.turned. @throws Interrupted.
MeshPatches turnPatches(OrientedTriangles& triangles, double gap, Interrupter& progress);

} // namespace mpuvdb
