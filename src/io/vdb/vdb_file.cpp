#include "files/atomic_file.h"
#include <mpuvdb/error.h>
#include <mpuvdb/given_level_set.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/io.h>
#include <mpuvdb/sampling.h>

#include "leaf_files.h"
#include "vdb_layout.h"
#include "vdb_stream.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <fstream>
#include <mutex>

namespace mpuvdb
{
namespace
{

using openvdb::FloatGrid;
using openvdb::GridBase;
namespace fs = std::filesystem;

/// Registers OpenVDB's types, once.
void initializeOpenVdb()
{
    static std::once_flag once;
    std::call_once(once, [] { openvdb::initialize(); });
}

/// Runs @a read on the opened file; OpenVDB's exceptions become ours.
template <typename Read>
auto withVdbFile(const fs::path& file, Interrupter* interrupter, const Read& read)
{
    initializeOpenVdb();
    checkVdbLayout(file);
    try {
        VdbReader archive(file, orSilent(interrupter));
        return read(archive);
    } catch (const Error&) {
        throw;
    } catch (const std::bad_alloc&) {
        throw LimitError(fmt::format("{}: needs more memory than it may take. Raise --max-memory, "
                                     "or read it on a larger machine",
                                     file.string()));
    } catch (const std::ios::failure&) {
        throw InputError(fmt::format("{}: ends, or cannot be read on, within a grid. Copy or write "
                                     "it again",
                                     file.string()));
    } catch (const std::exception& e) {
        throw InputError(fmt::format("{}: OpenVDB cannot read it: {}. Copy or write it again",
                                     file.string(), e.what()));
    }
}

bool isLevelSet(const GridBase& grid)
{
    return grid.getGridClass() == openvdb::GRID_LEVEL_SET && grid.isType<FloatGrid>();
}

std::string join(const std::vector<std::string>& texts)
{
    return fmt::format("{}", fmt::join(texts, ", "));
}

/// The cure for a file without a level set.
std::string cureWithoutLevelSet(VdbReader& archive)
{
    bool hasPoints = false;
    std::string uneven; // a grid of floats that isosurface() refuses
    for (const std::string& name : archive.names()) {
        const auto grid = archive.metadata(name);
        hasPoints |= grid->valueType().rfind("ptdataidx", 0) == 0;
        if (!grid->isType<FloatGrid>()) continue;
        if (!grid->transform().isLinear() || !grid->hasUniformVoxels()) {
            uneven = name;
            continue;
        }
        const bool isFog = grid->getGridClass() == openvdb::GRID_FOG_VOLUME;
        return fmt::format("Make one where '{}' has a value: mpuvdb isosurface {} --grid '{}' "
                           "--value 0.5 -o surface.vdb{}",
                           name, archive.filename(), name,
                           isFog ? ""
                                 : "; or with --value 0 --inside below, if it holds distances");
    }
    if (!uneven.empty())
        return fmt::format(
            "The voxels of '{}' are not cubes: resample it to uniform voxels where it "
            "comes from, for example with Houdini's VDB Resample; mpuvdb isosurface "
            "then makes a level set of it",
            uneven);
    if (hasPoints)
        return "Points are for mpuvdb reconstruct: write them as .ply where they come from";
    return "Write the surface itself beside them where they come from, as a grid of floats of the "
           "class level set";
}

/// The name of the level set to read.
std::string chooseLevelSet(VdbReader& archive, const std::string& wanted)
{
    std::vector<std::string> there, levelSets;
    for (const std::string& name : archive.names()) {
        const auto grid = archive.metadata(name);
        there.push_back(fmt::format("'{}' ({}, {})", name,
                                    GridBase::gridClassToString(grid->getGridClass()),
                                    grid->valueType()));
        if (isLevelSet(*grid)) levelSets.push_back(name);
    }
    const auto has = [&](const std::string& name) {
        return std::find(levelSets.begin(), levelSets.end(), name) != levelSets.end();
    };
    std::string name = wanted.empty() ? "surface" : wanted;
    if (has(name)) return name;
    if (wanted.empty() && levelSets.size() == 1) return levelSets[0];
    const std::string all = there.empty() ? "no grid at all" : join(there);
    if (!wanted.empty())
        throw InputError(fmt::format(
            "{}: has no float level set called '{}', but {}. {}", archive.filename(), wanted, all,
            levelSets.empty() ? cureWithoutLevelSet(archive) : "Name one of its level sets"));
    if (levelSets.empty())
        throw InputError(fmt::format("{}: has no float level set, but {}. {}", archive.filename(),
                                     all, cureWithoutLevelSet(archive)));
    throw InputError(fmt::format("{}: has several level sets: {}. Say which by its name",
                                 archive.filename(), join(levelSets)));
}

/// Reads the grids of a file as long as they fit into memory: OpenVDB and Blosc do not survive the
/// end of memory.
class GridReader
{
public:
    /// @param maxBytes  for all grids; 0: no limit.
    GridReader(VdbReader& archive, std::uint64_t maxBytes) : mArchive(archive), mMaxBytes(maxBytes)
    {
    }

    /// @throws LimitError by the grid's metadata; without them there is no limit.
    GridBase::Ptr read(const std::string& name)
    {
        constexpr double kOverhead = 1.1; // of reading [tuned: vdb_file_test]
        const auto said = mArchive.metadata(name)->getMetadata<openvdb::Int64Metadata>(
            GridBase::META_FILE_MEM_BYTES);
        mBytes += said ? kOverhead * double(std::max<std::int64_t>(said->value(), 0)) : 0;
        if (mMaxBytes > 0 && mBytes > double(mMaxBytes))
            throw LimitError(fmt::format("{}: grid '{}' takes {:.0f} MB with what is read before "
                                         "it, and {:.0f} are allowed. Allow more memory, or write "
                                         "it with larger voxels",
                                         mArchive.filename(), name, mBytes / 1e6,
                                         double(mMaxBytes) / 1e6));
        return mArchive.read(name);
    }

private:
    VdbReader& mArchive;
    std::uint64_t mMaxBytes;
    double mBytes = 0;
};

/// Makes a level set of a grid, and adds notes with the file's name.
LevelSet toLevelSet(const fs::path& file, const GridBase::Ptr& grid, Validation validation,
                    std::vector<std::string>& notes, Interrupter* interrupter)
{
    try {
        std::vector<std::string> said;
        LevelSet levelSet =
            levelSetFromGrid(openvdb::gridPtrCast<FloatGrid>(grid), said, interrupter);
        if (validation == Validation::Distances)
            requireDistances(levelSet,
                             fmt::format("Make distances: mpuvdb isosurface {} --grid '{}' "
                                         "--value 0 --inside below -o surface.vdb",
                                         file.string(), grid->getName()),
                             interrupter);
        for (const std::string& note : said) notes.push_back(file.string() + ": " + note);
        return levelSet;
    } catch (const InputError& e) {
        throw InputError(fmt::format("{}: {}", file.string(), e.what()));
    }
}

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
    void writeTo(std::ostream& out, openvdb::GridCPtrVec grids, const Interrupter& progress) const
    {
        for (GridBase::ConstPtr& grid : grids) grid = compressingInParallel(grid, progress);
        if (std::any_of(grids.begin(), grids.end(),
                        [](const auto& grid) { return dynamic_cast<const OfLeaves*>(&*grid); }))
            writeWithLeaves(out, grids);
        else
            Archive::write(out, grids, /*seekable=*/true, {});
    }

private:
    /// Archive::write() for grids some of which have no voxels, which it would look at; all have
    /// names and trees of their own.
    void writeWithLeaves(std::ostream& out, const openvdb::GridCPtrVec& grids) const
    {
        openvdb::io::StreamMetadata::Ptr ofStream(new openvdb::io::StreamMetadata);
        openvdb::io::setStreamMetadataPtr(out, ofStream, /*transfer=*/false);
        openvdb::io::setDataCompression(out, compression());
        openvdb::io::setWriteGridStatsMetadata(out, isGridStatsMetadataEnabled());
        writeHeader(out, /*seekable=*/true);
        openvdb::MetaMap().writeMeta(out);
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
FloatGrid::ConstPtr described(const LevelSet& levelSet,
                              const std::map<std::string, std::string>& metadata)
{
    const FloatGrid& grid = levelSet.grid();
    openvdb::MetaMap items(grid);
    for (const auto& [key, value] : metadata) {
        requireFree(key);
        items.removeMeta(key);
        items.insertMeta(key, openvdb::StringMetadata(value));
    }
    return openvdb::gridConstPtrCast<FloatGrid>(grid.copyReplacingMetadata(items));
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
                 const Interrupter& progress)
{
    InterruptibleBuffer buffer(progress);
    if (!buffer.open(file, std::ios::out | std::ios::binary | std::ios::trunc))
        throw IoError(
            fmt::format("{}: cannot be opened for writing. Write elsewhere", file.string()));
    std::ostream out(&buffer);
    out.exceptions(std::ios::failbit | std::ios::badbit);
    Writer().writeTo(out, grids, progress);
    if (!buffer.close()) out.setstate(std::ios::badbit);
}

/// Reads the metadata back. @throws IoError where they differ.
void verify(const fs::path& temporary, const fs::path& file, const openvdb::GridCPtrVec& grids)
{
    // In any order, as the file appends numbers to equal names.
    std::vector<std::int64_t> written, there;
    for (const GridBase::ConstPtr& grid : grids)
        written.push_back(std::int64_t(grid->activeVoxelCount()));
    withVdbFile(temporary, nullptr, [&](VdbReader& archive) {
        for (const std::string& name : archive.names()) {
            const auto read = archive.metadata(name);
            const auto voxels =
                read->getMetadata<openvdb::Int64Metadata>(GridBase::META_FILE_VOXEL_COUNT);
            there.push_back(voxels ? voxels->value() : -1);
        }
    });
    std::sort(written.begin(), written.end());
    std::sort(there.begin(), there.end());
    if (written != there)
        throw IoError(
            fmt::format("{}: does not read back as written. Write to another disk", file.string()));
}

} // namespace

LevelSet readLevelSet(const fs::path& file, const std::string& name, std::uint64_t maxBytes,
                      Validation validation, Interrupter* interrupter)
{
    const auto grid = withVdbFile(file, interrupter, [&](VdbReader& archive) {
        return GridReader(archive, maxBytes).read(chooseLevelSet(archive, name));
    });
    std::vector<std::string> notes;
    LevelSet levelSet = toLevelSet(file, grid, validation, notes, interrupter);
    for (std::string& note : notes) orSilent(interrupter).note(std::move(note));
    return levelSet;
}

LevelSetFile readLevelSetFile(const fs::path& file, const std::string& name, std::uint64_t maxBytes,
                              Interrupter* interrupter)
{
    return withVdbFile(file, interrupter, [&](VdbReader& archive) {
        const std::string chosen = chooseLevelSet(archive, name);
        GridReader reader(archive, maxBytes);
        GridBase::Ptr levelSet;
        openvdb::GridCPtrVec others;
        for (const std::string& item : archive.names()) {
            const GridBase::Ptr grid = reader.read(item);
            if (item == chosen)
                levelSet = grid;
            else
                others.push_back(grid);
        }
        std::vector<std::string> notes;
        const LevelSet taken =
            toLevelSet(file, levelSet, Validation::Distances, notes, interrupter);
        return LevelSetFile{taken, std::move(others), std::move(notes)};
    });
}

FloatGridFile readFloatGridFile(const fs::path& file, const std::string& name,
                                std::uint64_t maxBytes, Interrupter* interrupter)
{
    return withVdbFile(file, interrupter, [&](VdbReader& archive) {
        GridReader reader(archive, maxBytes);
        FloatGridFile result;
        std::vector<std::string> there;
        for (const std::string& item : archive.names()) {
            const GridBase::Ptr grid = reader.read(item);
            there.push_back(fmt::format("'{}' ({})", item, grid->valueType()));
            if (!result.grid && grid->isType<FloatGrid>() && (name.empty() || item == name))
                result.grid = openvdb::gridPtrCast<FloatGrid>(grid);
            else
                result.others.push_back(grid);
        }
        if (!result.grid)
            throw InputError(fmt::format("{}: has no grid of floats{}, but {}. Name one of floats",
                                         archive.filename(),
                                         name.empty() ? "" : " called '" + name + "'",
                                         there.empty() ? "no grid at all" : join(there)));
        return result;
    });
}

FloatGrid::Ptr readCoverage(const fs::path& file, std::uint64_t maxBytes, Interrupter* interrupter)
{
    return withVdbFile(file, interrupter, [&](VdbReader& archive) {
        std::vector<std::string> there;
        for (const std::string& name : archive.names()) {
            const auto grid = archive.metadata(name);
            if (name == kCoverageName && grid->isType<FloatGrid>() && grid->transform().isLinear())
                return openvdb::gridPtrCast<FloatGrid>(GridReader(archive, maxBytes).read(name));
            there.push_back("'" + name + "'");
        }
        throw InputError(fmt::format("{}: has no float grid '{}' that says where data support the "
                                     "surface, but {}. Write one beside it with mpuvdb reconstruct "
                                     "--coverage",
                                     archive.filename(), kCoverageName,
                                     there.empty() ? "no grid at all" : join(there)));
    });
}

std::vector<GridBase::Ptr> readAttributeGrids(const fs::path& file,
                                              const std::vector<std::string>& names,
                                              std::uint64_t maxBytes, Interrupter* interrupter)
{
    std::vector<GridBase::Ptr> grids(names.size());
    if (names.empty()) return grids;
    return withVdbFile(file, interrupter, [&](VdbReader& archive) {
        GridReader reader(archive, maxBytes);
        for (const std::string& there : archive.names()) {
            const auto found = std::find(names.begin(), names.end(), there);
            if (found == names.end()) continue;
            const auto grid = archive.metadata(there);
            if (grid->isType<FloatGrid>() || grid->isType<openvdb::Vec3SGrid>())
                grids[std::size_t(found - names.begin())] = reader.read(there);
        }
        return grids;
    });
}

openvdb::GridPtrVec readGrids(const fs::path& file, std::uint64_t maxBytes,
                              Interrupter* interrupter)
{
    return withVdbFile(file, interrupter, [&](VdbReader& archive) {
        GridReader reader(archive, maxBytes);
        openvdb::GridPtrVec grids;
        for (const std::string& item : archive.names()) grids.push_back(reader.read(item));
        return grids;
    });
}

openvdb::GridCPtrVec readGridHeads(const fs::path& file)
{
    return withVdbFile(file, nullptr, [&](VdbReader& archive) {
        openvdb::GridCPtrVec grids;
        for (const std::string& item : archive.names()) grids.push_back(archive.metadata(item));
        return grids;
    });
}

void writeLevelSet(const fs::path& file, const LevelSet& levelSet,
                   const std::map<std::string, std::string>& metadata,
                   const openvdb::GridCPtrVec& beside, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    openvdb::GridCPtrVec grids{described(levelSet, metadata)};
    grids.insert(grids.end(), beside.begin(), beside.end());
    writeGrids(file, grids, &progress);
}

void writeGrids(const fs::path& file, const openvdb::GridCPtrVec& grids, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    initializeOpenVdb();
    progress.beginStage("write", 1);
    writeAtomically(file, [&](const fs::path& temporary) {
        try {
            writeStream(temporary, grids, progress);
            setOldestVersion(temporary, grids);
            identifyByContent(temporary);
        } catch (const std::ios::failure& e) {
            const int number = errno; // of the last write
            throw IoError(fmt::format("{}: cannot be written: {}. Free some space, or write to "
                                      "another disk",
                                      file.string(), e.what()),
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
