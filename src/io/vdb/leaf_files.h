// Grids in parts: compressed leaves in files, and one grid of the leaves of many files.
#pragma once
#include "leaf_format.h"

#include <openvdb/io/DelayedLoadMetadata.h>

#include <functional>
#include <string>
#include <vector>

namespace mpuvdb
{

/// Write the leaves of @a grid in @a box to @a file, each compressed as in a .vdb file, with the
/// grid's metadata and transform; names begin with @a prefix. @a box holds whole leaves. Grids of
/// floats and of vectors of floats only. The same bytes for any number of threads.
/// @throws IoError, Interrupted.
void saveLeaves(ArrayFileWriter& file, const std::string& prefix, const openvdb::GridBase& grid,
                const openvdb::CoordBBox& box, const Interrupter& progress);

/// What is taken of the leaves in files.
struct LeafRegion {
    openvdb::CoordBBox box = openvdb::CoordBBox::inf(); ///< of whole leaves
    /// Boxes of whole nodes of leaves (multiples of 128 voxels), beside the box and without leaves,
    /// that are inside a level set.
    std::vector<openvdb::CoordBBox> inside;
};

/// The grid of the leaves that saveLeaves() wrote to @a files, whose boxes are apart, for a writer
/// of .vdb files: it has no voxels in memory, and its leaves' bytes are copied as they are. Between
/// the leaves of a level set are tiles of the sign of those beside them; beyond @a region it is
/// outside, as are nodes of leaves that are only in part in the region and have no leaf.
/// @param files  have to outlive the grid. @throws InputError (damaged files),
/// Interrupted.
openvdb::GridBase::Ptr gridOfLeaves(const std::vector<ArrayFile>& files, const std::string& prefix,
                                    const LeafRegion& region, const Interrupter& progress);

/// The same in @a box, of whole leaves, with its voxels. Without a leaf there it is empty.
/// @param wanted  leaves to read, by their origins, or null; others are left out.
openvdb::GridBase::Ptr readLeaves(const std::vector<ArrayFile>& files, const std::string& prefix,
                                  const openvdb::CoordBBox& box, const Interrupter& progress,
                                  const std::function<bool(const openvdb::Coord&)>& wanted = {});

/// Whether the block with @a voxel, which is in @a box and no leaf, is inside the level set. There
/// is a leaf in the box.
bool isSpaceInside(const std::vector<ArrayFile>& files, const std::string& prefix,
                   const openvdb::CoordBBox& box, const openvdb::Coord& voxel,
                   const Interrupter& progress);

/// The places of nodes of leaves of @a edge voxels in which @a file has a leaf, sorted.
std::vector<openvdb::Coord> nodesWithLeaves(const ArrayFile& file, const std::string& prefix,
                                            int edge);

/// Whether @a file has leaves of the grid.
bool hasLeaves(const ArrayFile& file, const std::string& prefix);

/// A grid for a writer of .vdb files that has its leaves as the file will have them, and no voxels.
class OfLeaves
{
public:
    virtual ~OfLeaves() = default;
    /// The metadata, with those that a .vdb file has of its voxels: OpenVDB's writer would look at
    /// the voxels themselves.
    virtual openvdb::MetaMap fileMetadata() const = 0;
};

/// Add to @a metadata what a .vdb file says of how its leaves are stored.
/// @param bytes  what reading them takes.
void addLeafMetadata(openvdb::MetaMap& metadata, std::uint64_t bytes,
                     const openvdb::io::DelayedLoadMetadata& leaves);

} // namespace mpuvdb
