// Scripts with which engines run the tasks of a job.
#pragma once
#include <cstdint>
#include <filesystem>
#include <string>

namespace mpuvdb::command
{

/// What an engine is told.
struct EngineJob {
    std::filesystem::path folder, output; ///< absolute
    int slots = 64;                       ///< tasks of a phase
    std::uint64_t maxBytes = 0;           ///< memory of a task
};

/// Write what @a engine (slurm, parallel, snakemake, openjd, list) needs into the job's folder.
/// @return the command that starts it. @throws IoError.
std::string writeEngine(const std::string& engine, const EngineJob& job);

} // namespace mpuvdb::command
