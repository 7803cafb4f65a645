// Reconstructions beyond memory and beyond one machine: a job in a folder, whose tasks run
// anywhere.
//
// A job is planned once: points are cleaned, measured and sorted, and what is decided from all of
// them is kept. Then come two phases of tasks, each of which maps the files that it needs and
// writes one whole file: first the octree is fitted in parts, then the grid is sampled in tiles.
// After each phase gather() joins what has to be known to all. merge() makes one grid of the tiles,
// byte for byte the one that reconstruct() makes at once.
#pragma once
#include <mpuvdb/io.h>
#include <mpuvdb/reconstruct.h>

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// How a job is cut up.
struct JobOptions {
    /// Edge of a tile, voxels: a multiple of 128, as a node of the grid then lies in one tile.
    int tileVoxels = 512;
    std::size_t partPoints = 4'000'000; ///< points of a part of the fit, about
    std::string build;                  ///< the program: only the same one may do the tasks
    std::map<std::string, std::string> metadata; ///< of the grid in the end
    std::vector<std::string> inputs;             ///< files; a changed one is refused
};

/// What a job comes to, before it starts.
struct JobEstimate {
    int tileVoxels = 0;           ///< edge of a tile
    std::size_t partPoints = 0;   ///< points of a part of the fit
    std::size_t tiles = 0;        ///< that hold points; those of filled holes come to them
    std::uint64_t taskBytes = 0;  ///< memory of the largest task, beside the pages of mapped files
    std::uint64_t mergeBytes = 0; ///< memory of merge() to one file
    std::uint64_t diskBytes = 0;  ///< of the job's folder and the result
    double cpuSeconds = 0;        ///< of all tasks: see ReconstructionEstimate
};

/// What a job comes to, and its tiles. @param run  the estimate of it at once. @param tileVoxels
/// their edge; default: the largest of 512, 256 and 128 voxels that takes at most half of @a
/// taskBytes, the memory of a task (0: no limit).
/// @throws LimitError if even that takes more than all of it, Interrupted.
JobEstimate estimateJob(const PreparedPoints& points, const ReconstructionEstimate& run,
                        std::optional<int> tileVoxels, std::uint64_t taskBytes,
                        Interrupter* interrupter = nullptr);

/// @throws UsageError unless tiles may have an edge of @a voxels.
void requireTile(int voxels);

/// The phases of a job.
enum class JobPhase : std::uint8_t { Fit, Sample };

/// The state of a task.
struct TaskState {
    enum class State : std::uint8_t { Waiting, Running, Done };
    State state = State::Waiting;
    double seconds = 0;          ///< that it took, if done
    std::uint64_t peakBytes = 0; ///< of the process, if done
    std::uint64_t points = 0;    ///< in its box, of a tile
    std::string host;            ///< where it is running, or has run
};

/// What a job came to.
struct JobResult {
    std::uint64_t voxels = 0;        ///< active ones of the grid
    std::vector<std::string> faults; ///< of the grid, as check() finds them in its tiles
    PointsExplained explained;       ///< as joinExplained() knows it
};

/// A job in a folder.
class Job
{
public:
    /// Plan a job in @a folder, which must not hold one yet.
    /// @throws UsageError (tiles, a job is there), InputError, IoError, LimitError, Interrupted.
    static void plan(const std::filesystem::path& folder, PreparedPoints&& points,
                     const JobOptions& options, Interrupter* interrupter = nullptr);

    /// Open the job in @a folder. @param build  as planned, or empty to look only.
    /// @throws InputError (no job, another build, an input that changed), IoError.
    Job(const std::filesystem::path& folder, const std::string& build);
    ~Job();

    JobPhase phase() const;
    /// Tasks of the phase.
    std::size_t tasks() const;
    std::vector<TaskState> states() const;
    /// Do task @a n of the phase, unless it is done. Whole files are written: a task that is
    /// killed, repeated, or done twice at once changes nothing. @throws UsageError (no such task),
    /// IoError, LimitError, Interrupted, InputError where other bytes are there than it made.
    void run(std::size_t n, Interrupter* interrupter = nullptr) const;
    /// Join the parts of the fit, and list the tiles; after the last tile verify all of them.
    /// @throws InputError naming the tasks that are missing or damaged, IoError, Interrupted.
    void gather(Interrupter* interrupter = nullptr);
    /// Take damaged results away, so that their tasks are done again. @return their number.
    std::size_t dropDamaged(Interrupter* interrupter = nullptr) const;
    /// Write one .vdb file of all tiles. Voxels are copied, never held. @throws as gather().
    JobResult merge(const std::filesystem::path& file, Interrupter* interrupter = nullptr) const;
    /// Write a folder instead: a .vdb file for each tile, with 8 voxels of its neighbors, which
    /// together (csgUnion) are what merge() writes; level sets of voxels 4 and 16 times larger; a
    /// USD layer of all; and an index of boxes and hashes. It appears whole or not at all, and
    /// replaces an earlier one. One tile is held at a time.
    /// @throws UsageError (other files are in the folder), else as merge().
    JobResult mergeToFolder(const std::filesystem::path& folder, const SceneSettings& scene = {},
                            Interrupter* interrupter = nullptr) const;
    /// The mesh that extractMesh() makes of the level set and the field, to the byte, with the
    /// job's attributes. One tile's voxels are held beside it: 36 bytes for each of its vertices.
    /// @param maxBytes  memory for it; 0: no limit. @param strict  as ExtractSettings::strict.
    /// @throws LimitError, else as merge().
    Mesh mesh(std::uint64_t maxBytes = 0, bool strict = false,
              Interrupter* interrupter = nullptr) const;
    /// The voxel size of the level set, world units.
    double voxelSize() const;
    /// The diagonal of the box of its active voxels, world units; 0: there are none. @throws as
    /// merge().
    double diagonal(Interrupter* interrupter = nullptr) const;
    /// Bytes of the tiles that are done: about those of their .vdb file.
    std::uint64_t bytes() const;
    /// The files that the points came from, as absolute paths.
    const std::vector<std::string>& inputs() const;

private:
    struct Impl;
    std::unique_ptr<Impl> mImpl;
};

} // namespace mpuvdb
