// The files of a job that say what it is and what was done: JSON, whole or not at all.
#pragma once
#include "tiles.h"
#include <mpuvdb/farm.h>

#include <nlohmann/json.hpp>

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace mpuvdb
{

using JobJson = nlohmann::ordered_json;
using FileHashes = std::map<std::string, std::string>; ///< by the files' names

/// The hashes of the files @a names in @a folder, as far as they are there. @throws Interrupted.
FileHashes hashesOf(const std::filesystem::path& folder, const std::vector<std::string>& names,
                    const Interrupter& progress);
/// @throws InputError unless the files in @a folder have the bytes that were written; Interrupted.
void requireFiles(const std::filesystem::path& folder, const FileHashes& hashes,
                  const Interrupter& progress);

/// @throws IoError.
void writeJson(const std::filesystem::path& file, const JobJson& json);

/// What a job is: plan.json.
struct JobPlan {
    std::string id; ///< a hash of all the rest
    JobOptions options;
    SampleSettings grid;
    bool coverage = false;               ///< whether a grid of it is made, too
    std::vector<std::string> attributes; ///< of which grids are made, too
    std::uint64_t points = 0, parts = 0;
    FileHashes files; ///< of the points, by their names in the folder

    static JobPlan read(const std::filesystem::path& folder);
    /// Write all that is set; sets the id.
    void write(const std::filesystem::path& folder);
    /// @throws InputError if an input is not what it was.
    void requireInputs() const;

private:
    JobJson mInputs; ///< sizes and times of the inputs
};

/// What a task made: beside its file, written after it.
struct TaskRecord {
    std::string plan, hash, host;
    std::uint64_t bytes = 0, peakBytes = 0;
    double seconds = 0;
    std::uint64_t voxels = 0;        ///< active ones of a tile
    std::vector<std::string> faults; ///< of a tile's grid, as check() finds them
    PointsExplained explained;       ///< of a tile: the points in it

    /// The record of @a file, if it is there and whole: without one the task is to be done again.
    static std::optional<TaskRecord> read(const std::filesystem::path& file);
    void write(const std::filesystem::path& file) const;
};

/// What is made once the fit is joined: tiles.json.
struct TileList {
    std::vector<Tile> tiles;
    FileHashes field; ///< of the file that they are sampled from
};
void writeTiles(const std::filesystem::path& file, const std::string& plan, const TileList& list);
/// Empty if there is no such file. @throws InputError (damaged, of another plan).
std::optional<TileList> readTiles(const std::filesystem::path& file, const std::string& plan);

} // namespace mpuvdb
