// The result of a job as a folder: a .vdb file for each tile, and what shows them as one.
#pragma once
#include "io/vdb/leaf_files.h"
#include "parted_grid.h"
#include <mpuvdb/io.h>

#include <nlohmann/json.hpp>

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// A tile of the result.
struct FolderTile {
    openvdb::CoordBBox box;
    std::uint64_t activeVoxels = 0; ///< of its level set, in the box
};

/// What a folder is made of.
struct FolderContent {
    std::vector<FolderTile> tiles; ///< those with leaves or not, by their numbers
    PartedGrid grid;               ///< of the level set
    double halfWidth = 3;          ///< voxels
    nlohmann::ordered_json about;  ///< what the index says beside the tiles
    /// The grids of some leaves, to be written; the first is the level set.
    std::function<openvdb::GridPtrVec(const std::vector<ArrayFile>&, const LeafRegion&)> grids;
    std::string levelSet; ///< what the names of its arrays begin with
    SceneSettings scene;
};

/// Write tiles/tile_00000.vdb and so on, coarse_4.vdb, coarse_16.vdb, volume.usda and index.json to
/// @a folder, which appears whole or not at all; one that such a call made is replaced. Holds one
/// tile's masks at a time, or the voxels of one tile, of 256 at least, for a coarser level.
/// @return what check() finds in the coarser levels. @throws UsageError (the folder has other
/// files), IoError, InputError (damaged files), Interrupted.
std::vector<std::string> writeTileFolder(const std::filesystem::path& folder,
                                         const FolderContent& content, Interrupter& progress);

} // namespace mpuvdb
