#include "tile_folder.h"

#include "coarse_grid.h"
#include "files/atomic_folder.h"
#include "files/content_hash.h"
#include "files/mapped_pages.h"
#include "inside_boxes.h"
#include "job_file.h"
#include "quiet.h"
#include <mpuvdb/error.h>

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <set>

namespace mpuvdb
{
namespace
{

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;
using openvdb::Coord;
using openvdb::CoordBBox;

/// Version of the index's format. [derived: the first]
constexpr int kFolderVersion = 1;
/// Voxels that a tile's file has beyond the tile. [derived: a leaf, whose bytes are copied; renders
/// interpolate two voxels beyond a place]
constexpr int kOverlap = kBlockDim;
/// How many voxels of the finer grid's edge are one of the coarser levels. [derived: each has a
/// sixteenth of the voxels of the one before, and 16 are what layouts ask for]
constexpr int kLevels[] = {4, 16};
/// Least edge, in voxels of a coarser level, of the parts that it is made in. [derived: of smaller
/// ones most is what lies about them, 24 voxels wide]
constexpr int kLeastEdge = 128;

constexpr const char* kIndex = "index.json";
constexpr const char* kLayer = "volume.usda";
constexpr const char* kTiles = "tiles";

Json jsonOf(const CoordBBox& box)
{
    const Coord &a = box.min(), &b = box.max();
    return {a[0], a[1], a[2], b[0], b[1], b[2]};
}

/// The box of the cubes of @a voxels, world units.
Json worldOf(const CoordBBox& voxels, const Lattice& lattice)
{
    Json corners = Json::array();
    for (int axis = 0; axis < 3; ++axis)
        corners.push_back(lattice.origin[axis] + lattice.voxelSize * (voxels.min()[axis] - 0.5));
    for (int axis = 0; axis < 3; ++axis)
        corners.push_back(lattice.origin[axis] + lattice.voxelSize * (voxels.max()[axis] + 0.5));
    return corners;
}

/// The files of a folder, relative to it; not those of file systems and engines, whose names begin
/// with a dot.
std::set<std::string> filesOf(const fs::path& folder)
{
    std::set<std::string> files;
    for (const fs::directory_entry& entry : fs::recursive_directory_iterator(folder))
        if (!entry.is_directory() && entry.path().filename().string().front() != '.')
            files.insert(entry.path().lexically_relative(folder).generic_string());
    return files;
}

/// @throws UsageError unless all of @a folder is what an index says.
void requireOwn(const fs::path& folder)
{
    std::ifstream in(folder / kIndex, std::ios::binary);
    const Json index = Json::parse(in, nullptr, /*allow_exceptions=*/false);
    std::set<std::string> foreign = filesOf(folder);
    if (index.is_object() && index.contains("files") && index["files"].is_array())
        for (const Json& file : index["files"])
            if (file.is_string()) foreign.erase(file.get<std::string>());
    if (!foreign.empty())
        throw UsageError(fmt::format("{}: has files that are not of an earlier result, such as {}: "
                                     "name another folder, or remove it",
                                     folder.string(), *foreign.begin()));
}

class FolderWriter
{
public:
    FolderWriter(const FolderContent& content, const fs::path& folder, Interrupter& progress)
        : mContent(content), mFolder(folder), mProgress(progress), mQuiet(progress),
          mGrid(content.grid)
    {
    }

    std::vector<std::string> write()
    {
        fs::create_directory(mFolder / kTiles);
        mInside = insideBoxes(mGrid, mContent.levelSet, mProgress);
        mProgress.beginStage("tiles", double(mContent.tiles.size()));
        for (std::size_t n = 0; n < mContent.tiles.size(); ++n) {
            mProgress.advance();
            if (mGrid.parts().count(mGrid.cubeOf(mContent.tiles[n].box.min())) > 0) writeTile(n);
        }
        mProgress.endStage();
        std::vector<std::string> faults = writeLevels();
        writeVolumeLayer(mFolder / kLayer, mVolumes, mContent.scene);
        writeIndex();
        return faults;
    }

private:
    /// Writes grids to a file of the folder. @return what the index says of the file.
    Json writeFile(const std::string& name, const openvdb::GridPtrVec& grids)
    {
        const fs::path file = mFolder / name;
        writeGrids(file, {grids.begin(), grids.end()}, &mQuiet);
        return {
            {"file", name}, {"bytes", fs::file_size(file)}, {"hash", contentHash(file, mProgress)}};
    }

    void writeTile(std::size_t n)
    {
        const FolderTile& tile = mContent.tiles[n];
        LeafRegion region;
        region.box = tile.box;
        region.box.expand(kOverlap);
        const std::vector<ArrayFile> files = mGrid.filesIn(region.box);
        const auto inside = mInside.find(mGrid.cubeOf(tile.box.min()));
        if (inside != mInside.end()) region.inside = inside->second;
        const std::string name = fmt::format("{}/tile_{:05}.vdb", kTiles, n);
        Json about = writeFile(name, mContent.grids(files, region));
        about["box"] = jsonOf(tile.box);
        about["world"] = worldOf(tile.box, mGrid.lattice());
        about["active_voxels"] = tile.activeVoxels;
        about["inside"] = Json::array();
        for (const CoordBBox& box : region.inside) about["inside"].push_back(jsonOf(box));
        mTiles.push_back(std::move(about));
        mVolumes.push_back({mFolder / name});
        forgetMappedPages();
    }

    std::vector<std::string> writeLevels()
    {
        const fs::path parts = mFolder / "parts";
        fs::create_directory(parts);
        std::vector<std::string> faults;
        PartedGrid grid = mGrid;
        // Parts of all levels are made of as many voxels: a tile's, and those about it.
        const int edge = std::max(mGrid.edge() / kCoarsening, kLeastEdge);
        int voxels = 1; // of the finest grid along one of the coarser
        for (const int factor : kLevels) {
            for (; voxels < factor && !grid.parts().empty(); voxels *= kCoarsening)
                grid = coarserGrid(grid, mContent.levelSet, edge, parts / std::to_string(voxels),
                                   faults, mProgress);
            if (grid.parts().empty()) break; // nothing is as large as its voxels
            const openvdb::GridBase::Ptr whole =
                gridOfLeaves(grid.files(), mContent.levelSet, {}, mProgress);
            const std::string name = fmt::format("coarse_{}.vdb", factor);
            Json about = writeFile(name, {whole});
            about["voxels_in_one"] = factor;
            about["voxel_size"] = grid.lattice().voxelSize;
            about["active_voxels"] = whole->activeVoxelCount();
            mLevels.push_back(std::move(about));
            if (factor == kLevels[0]) mVolumes.push_back({mFolder / name, /*isProxy=*/true});
        }
        fs::remove_all(parts);
        return faults;
    }

    void writeIndex() const
    {
        const Vec3d& o = mGrid.lattice().origin;
        Json index = {{"mpuvdb_tiles", kFolderVersion}};
        index.update(mContent.about);
        index["voxel_size"] = mGrid.lattice().voxelSize;
        index["origin"] = {o[0], o[1], o[2]};
        index["half_width"] = mContent.halfWidth;
        index["tile_voxels"] = mGrid.edge();
        index["overlap_voxels"] = kOverlap;
        index["layer"] = kLayer;
        index["tiles"] = mTiles;
        index["levels"] = mLevels;
        std::set<std::string> files = filesOf(mFolder);
        files.insert(kIndex);
        index["files"] = files;
        writeJson(mFolder / kIndex, index);
    }

    const FolderContent& mContent;
    fs::path mFolder;
    Interrupter& mProgress;
    Quiet mQuiet;
    const PartedGrid& mGrid;
    std::map<Coord, std::vector<CoordBBox>> mInside;
    Json mTiles = Json::array(), mLevels = Json::array();
    std::vector<VolumePart> mVolumes;
};

} // namespace

std::vector<std::string> writeTileFolder(const fs::path& folder, const FolderContent& content,
                                         Interrupter& progress)
{
    std::vector<std::string> faults;
    writeFolderAtomically(folder, requireOwn, [&](const fs::path& temporary) {
        faults = FolderWriter(content, temporary, progress).write();
    });
    return faults;
}

} // namespace mpuvdb
