// Coarser level sets of a grid in parts, one part after the other.
#pragma once
#include "parted_grid.h"

#include <filesystem>
#include <string>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// How many voxels of the finer grid's edge are one of the coarser. [derived: the least, for which
/// the band is widened least]
constexpr int kCoarsening = 2;

/// A coarser level set: its voxel (i,j,k) is the finer grid's voxel (2i,2j,2k). Where its surface
/// lies, values are the distances to the finer surface; in the rest of its band of 3 voxels
/// they are measured from its own zero set. So it is a level set in its own right, and parts of a
/// solid that are thinner than its voxels may be missing from it.
/// @param fine  a level set in parts, with names that begin with @a prefix. @param edge  of the
/// parts of the result, voxels: whole leaves. @param folder  gets a file for each of them.
/// @param faults  gets what check() finds.
/// @throws IoError, InputError (damaged files), Interrupted.
PartedGrid coarserGrid(const PartedGrid& fine, const std::string& prefix, int edge,
                       const std::filesystem::path& folder, std::vector<std::string>& faults,
                       Interrupter& progress);

} // namespace mpuvdb
