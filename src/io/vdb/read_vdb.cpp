// Level sets and other grids from .vdb files.
#include <mpuvdb/distances.h>
#include <mpuvdb/error.h>
#include <mpuvdb/given_level_set.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/io.h>
#include <mpuvdb/sampling.h>

#include "vdb_layout.h"
#include "vdb_stream.h"

#include <fmt/format.h>

#include <algorithm>

namespace mpuvdb
{
namespace
{

using openvdb::FloatGrid;
using openvdb::GridBase;
namespace fs = std::filesystem;

/// Runs @a read on the opened file; OpenVDB's exceptions become ours.
template <typename Read>
auto withVdbFile(const fs::path& file, Interrupter* interrupter, const Read& read)
{
    openvdb::initialize();
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
        const auto given = openvdb::gridPtrCast<FloatGrid>(grid);
        LevelSet levelSet =
            validation == Validation::SignsOnly
                ? levelSetFromGrid(given, said, interrupter)
                : distancesFromGrid(given,
                                    fmt::format("Make distances: mpuvdb isosurface {} --grid '{}' "
                                                "--value 0 --inside below -o surface.vdb",
                                                file.string(), grid->getName()),
                                    said, interrupter);
        for (const std::string& note : said) notes.push_back(file.string() + ": " + note);
        return levelSet;
    } catch (const InputError& e) {
        throw InputError(fmt::format("{}: {}", file.string(), e.what()));
    }
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
        return LevelSetFile{taken, std::move(others), archive.fileMetadata(), std::move(notes)};
    });
}

FloatGridFile readFloatGridFile(const fs::path& file, const std::string& name,
                                std::uint64_t maxBytes, Interrupter* interrupter)
{
    return withVdbFile(file, interrupter, [&](VdbReader& archive) {
        GridReader reader(archive, maxBytes);
        FloatGridFile result;
        result.metadata = archive.fileMetadata();
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

openvdb::MetaMap readFileMetadata(const fs::path& file)
{
    return withVdbFile(file, nullptr,
                       [](VdbReader& archive) { return openvdb::MetaMap(archive.fileMetadata()); });
}

openvdb::GridCPtrVec readGridHeads(const fs::path& file)
{
    return withVdbFile(file, nullptr, [&](VdbReader& archive) {
        openvdb::GridCPtrVec grids;
        for (const std::string& item : archive.names()) grids.push_back(archive.metadata(item));
        return grids;
    });
}

} // namespace mpuvdb
