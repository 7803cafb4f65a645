// Makes a closed band a true distance again, only where it is none.
#pragma once
#include <cstdint>
#include <openvdb/openvdb.h>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// Where a band's values come from.
enum class ValuesFrom : std::uint8_t {
    Field,    ///< about distances: where they rise too fast over several voxels, all do alike
    Distances ///< found by voxel: those that are no distances are wrong each for itself
};

/// Find voxels of @a tree (a narrow band, closed, signs right) whose upwind gradient is not about
/// 1, which jump from a neighbor, or which the band misses; give each the distance to the nearest
/// crossing of the zero set with an edge between voxels, or scale it with its neighbors. All other
/// values, and where the zero set crosses, stay as they are. Returns the number of voxels changed.
/// @param voxelSize  world units.
std::uint64_t restoreDistance(openvdb::FloatTree& tree, double voxelSize, ValuesFrom from,
                              Interrupter& progress);

/// What is known of the voxels of one leaf.
struct KnownVoxels {
    using Mask = openvdb::FloatTree::LeafNodeType::NodeMaskType;

    openvdb::Coord origin;
    Mask exact;              ///< even if flat, as at tips
    bool isDoubtful = false; ///< whether others may be wrong
    Mask unplaced{};         ///< to be measured: the values are no more than bounds
    Mask placed{};           ///< by a crease, or a surface beside it
};

/// The same in and about the doubtful leaves, and from there as far as values change.
/// @param known  leaves by origin, in order; all of others is exact.
std::uint64_t restoreDistance(openvdb::FloatTree& tree, double voxelSize,
                              const std::vector<KnownVoxels>& known, Interrupter& progress);

/// The same for a band cut from a wider one: what was a little too far there may be missed here.
/// Of the values only those change that jump.
std::uint64_t completeBand(openvdb::FloatTree& tree, double voxelSize, Interrupter& progress);

} // namespace mpuvdb
