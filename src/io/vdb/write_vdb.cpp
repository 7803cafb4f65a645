// Grids to .vdb files, whole or not at all, with the same bytes for the same grids.
#include "files/atomic_file.h"
#include "files/system_message.h"
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/io.h>

#include "leaf_files.h"
#include "vdb_layout.h"
#include "vdb_stream.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <fstream>

namespace mpuvdb
{
namespace
{

using openvdb::GridBase;
namespace fs = std::filesystem;

/// OpenVDB's writer onto a stream of ours, as its File cannot be interrupted.
class Writer : public openvdb::io::Archive
{
public:
    Writer()
    {
        setCompression(
            openvdb::io::COMPRESS_ACTIVE_MASK |
            (hasBloscCompression() ? openvdb::io::COMPRESS_BLOSC : openvdb::io::COMPRESS_ZIP));
    }
    void writeTo(std::ostream& out, openvdb::GridCPtrVec grids, const openvdb::MetaMap& ofFile,
                 const Interrupter& progress) const
    {
        for (GridBase::ConstPtr& grid : grids) grid = compressingInParallel(grid, progress);
        if (std::any_of(grids.begin(), grids.end(),
                        [](const auto& grid) { return dynamic_cast<const OfLeaves*>(&*grid); }))
            writeWithLeaves(out, grids, ofFile);
        else
            Archive::write(out, grids, /*seekable=*/true, ofFile);
    }

private:
    /// Archive::write() for grids some of which have no voxels, which it would look at; all have
    /// names and trees of their own.
    void writeWithLeaves(std::ostream& out, const openvdb::GridCPtrVec& grids,
                         const openvdb::MetaMap& ofFile) const
    {
        openvdb::io::StreamMetadata::Ptr ofStream(new openvdb::io::StreamMetadata);
        openvdb::io::setStreamMetadataPtr(out, ofStream, /*transfer=*/false);
        openvdb::io::setDataCompression(out, compression());
        openvdb::io::setWriteGridStatsMetadata(out, isGridStatsMetadataEnabled());
        writeHeader(out, /*seekable=*/true);
        ofFile.writeMeta(out);
        const auto count = std::int32_t(grids.size());
        out.write(reinterpret_cast<const char*>(&count), sizeof count);
        for (const GridBase::ConstPtr& grid : grids) {
            openvdb::io::GridDescriptor place(grid->getName(), grid->type(),
                                              grid->saveFloatAsHalf());
            if (const auto* const leaves = dynamic_cast<const OfLeaves*>(&*grid))
                writeLeaves(out, place, *grid, leaves->fileMetadata());
            else
                writeGrid(place, grid, out, /*seekable=*/true);
            openvdb::io::setDataCompression(out, compression());
        }
    }

    void writeLeaves(std::ostream& out, openvdb::io::GridDescriptor& place, const GridBase& grid,
                     const openvdb::MetaMap& metadata) const
    {
        place.writeHeader(out);
        const auto positions = out.tellp();
        place.writeStreamPos(out); // to be written again
        place.setGridPos(out.tellp());
        setGridCompression(out, grid);
        metadata.writeMeta(out);
        grid.writeTransform(out);
        grid.writeTopology(out);
        place.setBlockPos(out.tellp());
        grid.writeBuffers(out);
        place.setEndPos(out.tellp());
        out.seekp(positions);
        place.writeStreamPos(out);
        place.seekToEnd(out);
    }
};

/// @throws UsageError for a name under which OpenVDB keeps what readers need: another text there
/// makes another grid of it, or none.
void requireFree(const std::string& name)
{
    using Grid = openvdb::GridBase;
    for (const char* const own :
         {Grid::META_GRID_CLASS, Grid::META_IS_LOCAL_SPACE, Grid::META_SAVE_HALF_FLOAT,
          Grid::META_VECTOR_TYPE, Grid::META_FILE_BBOX_MIN, Grid::META_FILE_BBOX_MAX,
          Grid::META_FILE_COMPRESSION, Grid::META_FILE_MEM_BYTES, Grid::META_FILE_VOXEL_COUNT,
          Grid::META_FILE_DELAYED_LOAD})
        if (name == own)
            throw UsageError(fmt::format(
                "metadata '{}': OpenVDB keeps what it reads grids by there. Use another name",
                name));
}

/// The grid with our metadata, sharing its tree; the writer adds statistics.
openvdb::FloatGrid::ConstPtr described(const LevelSet& levelSet,
                                       const std::map<std::string, std::string>& metadata)
{
    const openvdb::FloatGrid& grid = levelSet.grid();
    openvdb::MetaMap items(grid);
    for (const auto& [key, value] : metadata) {
        requireFree(key);
        items.removeMeta(key);
        items.insertMeta(key, openvdb::StringMetadata(value));
    }
    return openvdb::gridConstPtrCast<openvdb::FloatGrid>(grid.copyReplacingMetadata(items));
}

/// Sets the version to 224, which more programs read, unless a grid needs 225: newer OpenVDBs
/// always write 225, which adds a type of grids (half).
void setOldestVersion(const fs::path& file, const openvdb::GridCPtrVec& grids)
{
    constexpr std::uint32_t kFormat = 224; // [derived: OpenVDB's format]
    const auto isHalf = [](const auto& grid) { return grid->valueType() == "half"; };
    if (openvdb::OPENVDB_FILE_VERSION <= kFormat || std::any_of(grids.begin(), grids.end(), isHalf))
        return;
    std::fstream stream(file, std::ios::in | std::ios::out | std::ios::binary);
    stream.exceptions(std::ios::failbit | std::ios::badbit);
    stream.seekp(kVdbVersionOffset);
    stream.write(reinterpret_cast<const char*>(&kFormat), sizeof kFormat);
    stream.close();
}

/// Replaces the random identifier by a hash of the content, so that equal grids give equal bytes.
void identifyByContent(const fs::path& file)
{
    std::fstream stream(file, std::ios::in | std::ios::out | std::ios::binary);
    stream.exceptions(std::ios::failbit | std::ios::badbit);
    const std::string blank(kVdbUuidSize, '0');
    stream.seekp(kVdbUuidOffset);
    stream.write(blank.data(), std::streamsize(blank.size()));
    stream.seekg(0);
    // Two FNV-1a hashes of 64-bit words.
    std::array<std::uint64_t, 2> hash = {0xcbf29ce484222325u, 0x6c62272e07bb0142u};
    std::vector<std::uint64_t> words(1 << 16);
    for (auto left = fs::file_size(file); left > 0;) {
        const std::size_t bytes = std::min<std::size_t>(left, words.size() * sizeof words[0]);
        words[(bytes - 1) / sizeof words[0]] = 0;
        stream.read(reinterpret_cast<char*>(words.data()), std::streamsize(bytes));
        for (std::size_t w = 0; w * sizeof words[0] < bytes; ++w)
            hash[w % 2] = (hash[w % 2] ^ words[w]) * 0x100000001b3u ^ (hash[w % 2] >> 29);
        left -= bytes;
    }
    const std::string uuid =
        fmt::format("{:08x}-{:04x}-8{:03x}-{:04x}-{:012x}", hash[0] >> 32, hash[0] >> 16 & 0xffff,
                    hash[0] & 0xfff, (hash[1] >> 48 & 0x3fff) | 0x8000, hash[1] & 0xffffffffffffu);
    stream.seekp(kVdbUuidOffset);
    stream.write(uuid.data(), std::streamsize(uuid.size()));
    stream.close();
}

void writeStream(const fs::path& file, const openvdb::GridCPtrVec& grids,
                 const openvdb::MetaMap& ofFile, const Interrupter& progress)
{
    InterruptibleBuffer buffer(progress);
    if (!buffer.open(file, std::ios::out | std::ios::binary | std::ios::trunc))
        throw IoError(
            fmt::format("{}: cannot be opened for writing. Write elsewhere", file.string()));
    std::ostream out(&buffer);
    out.exceptions(std::ios::failbit | std::ios::badbit);
    Writer().writeTo(out, grids, ofFile, progress);
    if (!buffer.close()) out.setstate(std::ios::badbit);
}

/// Reads the metadata back. @throws IoError where they differ.
void verify(const fs::path& temporary, const fs::path& file, const openvdb::GridCPtrVec& grids)
{
    // In any order, as the file appends numbers to equal names.
    std::vector<std::int64_t> written, there;
    for (const GridBase::ConstPtr& grid : grids)
        written.push_back(std::int64_t(grid->activeVoxelCount()));
    for (const GridBase::ConstPtr& read : readGridHeads(temporary)) {
        const auto voxels =
            read->getMetadata<openvdb::Int64Metadata>(GridBase::META_FILE_VOXEL_COUNT);
        there.push_back(voxels ? voxels->value() : -1);
    }
    std::sort(written.begin(), written.end());
    std::sort(there.begin(), there.end());
    if (written != there)
        throw IoError(
            fmt::format("{}: does not read back as written. Write to another disk", file.string()));
}
} // namespace

void writeLevelSet(const fs::path& file, const LevelSet& levelSet,
                   const std::map<std::string, std::string>& metadata,
                   const openvdb::GridCPtrVec& beside, Interrupter* interrupter)
{
    writeLevelSet(file, levelSet, metadata, beside, openvdb::MetaMap(), interrupter);
}

void writeLevelSet(const fs::path& file, const LevelSet& levelSet,
                   const std::map<std::string, std::string>& metadata,
                   const openvdb::GridCPtrVec& beside, const openvdb::MetaMap& ofFile,
                   Interrupter* interrupter)
{
    openvdb::GridCPtrVec grids{described(levelSet, metadata)};
    grids.insert(grids.end(), beside.begin(), beside.end());
    writeGrids(file, grids, ofFile, interrupter);
}

void writeGrids(const fs::path& file, const openvdb::GridCPtrVec& grids, Interrupter* interrupter)
{
    writeGrids(file, grids, openvdb::MetaMap(), interrupter);
}

void writeGrids(const fs::path& file, const openvdb::GridCPtrVec& grids,
                const openvdb::MetaMap& ofFile, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    openvdb::initialize();
    progress.beginStage("write", 1);
    writeAtomically(file, [&](const fs::path& temporary) {
        try {
            writeStream(temporary, grids, ofFile, progress);
            setOldestVersion(temporary, grids);
            identifyByContent(temporary);
        } catch (const std::ios::failure&) {
            const int number = errno; // of the last write
            throw IoError(fmt::format("{}: cannot be written: {}. Free some space, or write to "
                                      "another disk",
                                      file.string(), systemMessage(number)),
                          number);
        } catch (const openvdb::Exception& e) {
            throw IoError(
                fmt::format("{}: OpenVDB cannot write it: {}. Free some space, or write to "
                            "another disk",
                            file.string(), e.what()));
        }
        progress.check();
        verify(temporary, file, grids);
    });
    progress.advance();
    progress.endStage();
}

} // namespace mpuvdb
