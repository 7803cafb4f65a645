// Repair of a closed band where its values are not distances.
#pragma once
#include <cstdint>
#include <openvdb/openvdb.h>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// Origin of a band's values.
enum class ValuesFrom : std::uint8_t {
    Field,    ///< approximate distances: errors of the slope are smooth over several voxels
    Distances ///< distances computed by voxel: errors are independent
};

/// Find voxels of @a tree (a narrow band, closed, with the right signs) whose upwind gradient is
/// not about 1, which jump from a neighbor, or which the band lacks; set each to the distance to
/// the nearest crossing of the zero set with an edge between voxels, or scale it with its
/// neighbors. All other values and all crossings stay unchanged. @param voxelSize  world units.
/// @returns the number of voxels changed. @throws Interrupted.
/// @param among  voxels: leaves with origins elsewhere stay, with what is missing beside them.
std::uint64_t restoreDistance(openvdb::FloatTree& tree, double voxelSize, ValuesFrom from,
                              Interrupter& progress,
                              const openvdb::CoordBBox& among = openvdb::CoordBBox::inf());

/// Masks of one leaf's voxels by what is known of their values.
struct KnownVoxels {
    using Mask = openvdb::FloatTree::LeafNodeType::NodeMaskType;

    openvdb::Coord origin;
    Mask exact;             ///< right even if flat, as at tips
    bool isSuspect = false; ///< whether others may be wrong
    Mask unplaced{};        ///< to be measured: the values are bounds
    Mask placed{};          ///< measured from a crease, or from a surface beside it
};

/// The same for values from ValuesFrom::Distances, in and about the suspect leaves, and from there
/// as far as values change. @param known  leaves in order of origin; all voxels of others are
/// exact.
std::uint64_t restoreDistance(openvdb::FloatTree& tree, double voxelSize,
                              const std::vector<KnownVoxels>& known, Interrupter& progress);

/// The same for a band cut from a wider one, which may lack voxels that were a little too far. Only
/// values that jump change.
std::uint64_t completeBand(openvdb::FloatTree& tree, double voxelSize, Interrupter& progress);

} // namespace mpuvdb
