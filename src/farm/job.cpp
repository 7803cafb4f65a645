#include "core/peak_memory.h"
#include "files/array_file.h"
#include "files/atomic_file.h"
#include "files/content_hash.h"
#include "io/vdb/leaf_files.h"
#include "job_file.h"
#include "mpu/spread_fit.h"
#include "task_mark.h"
#include "tile_folder.h"
#include "tile_mesh.h"
#include "tiles.h"
#include <mpuvdb/attribute_grids.h>
#include <mpuvdb/error.h>
#include <mpuvdb/explained.h>
#include <mpuvdb/farm.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/io.h>
#include <mpuvdb/sampling.h>

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>

namespace mpuvdb
{
namespace
{

namespace fs = std::filesystem;

/// What the names of a grid's arrays begin with: the level set is the first grid.
std::string prefixOf(std::size_t grid)
{
    return fmt::format("grid {} ", grid);
}

void makeFolder(const fs::path& folder)
{
    std::error_code error;
    fs::create_directories(folder, error);
    if (error)
        throw IoError(
            fmt::format("{}: the folder cannot be made: {}", folder.string(), error.message()));
}

/// Remove all that a job makes in @a folder.
void clear(const fs::path& folder)
{
    std::error_code ignored;
    for (const char* const made : {"plan.json", "tiles.json", "fit", "tiles", "field.bin"})
        fs::remove_all(folder / made, ignored);
    for (const char* const file : SpreadFit::kFiles) fs::remove(folder / file, ignored);
}

/// Write all that is decided from @a points to @a folder, which is there.
void writePlan(const fs::path& folder, PreparedPoints&& points, const JobOptions& options,
               Interrupter& progress)
{
    const ResolvedSettings& resolved = points.report.settings;
    SpreadFit::plan(folder, std::move(points.cloud), resolved.fit, options.partPoints, progress);
    const SpreadFit fit(folder);
    JobPlan plan;
    plan.options = options;
    plan.grid = resolved.grid;
    plan.coverage = points.options.coverage;
    plan.attributes = points.options.attributes;
    plan.points = fit.points().size();
    plan.parts = fit.parts();
    plan.files = hashesOf(folder, {SpreadFit::kFiles.begin(), SpreadFit::kFiles.end()}, progress);
    plan.write(folder);
}

/// The box of the cubes of @a voxels, world units.
Box3d boxOf(const openvdb::CoordBBox& voxels, const Lattice& lattice)
{
    const auto place = [&](const openvdb::Coord& at, double beside) -> Vec3d {
        const Vec3d voxel(at[0], at[1], at[2]);
        return lattice.origin + lattice.voxelSize * (voxel + Vec3d::Constant(beside));
    };
    return {place(voxels.min(), -0.5), place(voxels.max(), 0.5)};
}

/// The active voxels of @a grid in @a box.
std::uint64_t activeVoxelsIn(const openvdb::FloatGrid& grid, const openvdb::CoordBBox& box)
{
    std::uint64_t voxels = 0;
    for (auto leaf = grid.tree().cbeginLeaf(); leaf; ++leaf)
        if (box.isInside(leaf->origin())) voxels += leaf->onVoxelCount();
    return voxels;
}

} // namespace

struct Job::Impl {
    fs::path folder;
    JobPlan plan;
    std::optional<std::vector<Tile>> tiles; ///< once the fit is joined
    FileHashes fieldHash;                   ///< the same
    /// @{ What tiles are sampled from; once one is.
    mutable std::shared_ptr<const MpuField> field;
    mutable std::unique_ptr<const Coverage> coverage;
    mutable std::unique_ptr<const SurfaceAttributes> attributes;
    /// @}

    fs::path fieldFile() const { return folder / "field.bin"; }
    fs::path tilesFile() const { return folder / "tiles.json"; }
    fs::path resultOf(JobPhase phase, std::size_t n) const
    {
        return folder / (phase == JobPhase::Fit ? "fit" : "tiles") / fmt::format("{:05}.bin", n);
    }
    static fs::path recordOf(fs::path result) { return result.replace_extension(".json"); }
    static fs::path markOf(fs::path result) { return result.replace_extension(".running"); }
    JobPhase phase() const { return tiles ? JobPhase::Sample : JobPhase::Fit; }
    std::size_t tasksOf(JobPhase phase) const
    {
        return phase == JobPhase::Fit ? std::size_t(plan.parts) : tiles ? tiles->size() : 0;
    }

    /// The record of a whole result of this plan.
    std::optional<TaskRecord> doneBy(const fs::path& result) const
    {
        std::optional<TaskRecord> record = TaskRecord::read(recordOf(result));
        std::error_code error;
        if (!record || record->plan != plan.id || fs::file_size(result, error) != record->bytes)
            return std::nullopt;
        return record;
    }
    /// Whether a result has the bytes that were written.
    bool isSound(const fs::path& result, const Interrupter& progress) const
    {
        const auto record = doneBy(result);
        return record && contentHash(result, progress) == record->hash;
    }
    void requireAll(JobPhase phase, Interrupter& progress) const;
    std::vector<fs::path> resultsOf(JobPhase phase) const
    {
        std::vector<fs::path> files;
        for (std::size_t n = 0; n < tasksOf(phase); ++n) files.push_back(resultOf(phase, n));
        return files;
    }
    /// The field, of which only what is said of all of it is read.
    const MpuField& fieldOnly() const
    {
        if (!field) field = SpreadFit::open(folder, fieldFile());
        return *field;
    }
    void openField(Interrupter& progress) const;
    void requireTiles(Interrupter& progress) const;
    openvdb::GridPtrVec joined(const std::vector<ArrayFile>& files, const LeafRegion& region,
                               Interrupter& progress) const;
    PartedGrid parted() const;
    JobResult result() const;
    void sample(std::size_t n, const fs::path& file, TaskRecord& record,
                Interrupter& progress) const;
};

void requireTile(int voxels)
{
    if (voxels < 128 || voxels % 128 != 0)
        throw UsageError(
            fmt::format("tiles of {} voxels: their edge must be a multiple of 128", voxels));
}

void Job::plan(const fs::path& folder, PreparedPoints&& points, const JobOptions& options,
               Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    requireTile(options.tileVoxels);
    if (points.options.region)
        throw UsageError("a job makes all of a level set: do without the region");
    if (fs::exists(folder / "plan.json"))
        throw UsageError(fmt::format("{}: there is a job already: choose another folder, or remove "
                                     "that one",
                                     folder.string()));
    const bool wasThere = fs::exists(folder);
    try {
        clear(folder); // of a plan that was killed, or a job whose plan was removed
        makeFolder(folder / "fit");
        makeFolder(folder / "tiles");
        writePlan(folder, std::move(points), options, progress);
    } catch (...) {
        clear(folder);
        std::error_code ignored;
        if (!wasThere) fs::remove(folder, ignored);
        throw;
    }
}

Job::Job(const fs::path& folder, const std::string& build) : mImpl(std::make_unique<Impl>())
{
    mImpl->folder = folder;
    mImpl->plan = JobPlan::read(folder);
    const std::string& planned = mImpl->plan.options.build;
    if (!build.empty() && build != planned)
        throw InputError(fmt::format("{}: planned by another build of mpuvdb ({}, this is {}): all "
                                     "tasks have to be done by the same one",
                                     folder.string(), planned, build));
    if (!build.empty()) mImpl->plan.requireInputs();
    if (std::optional<TileList> list = readTiles(mImpl->tilesFile(), mImpl->plan.id)) {
        mImpl->tiles = std::move(list->tiles);
        mImpl->fieldHash = std::move(list->field);
    }
}

Job::~Job() = default;

JobPhase Job::phase() const
{
    return mImpl->phase();
}

std::size_t Job::tasks() const
{
    return mImpl->tasksOf(phase());
}

std::vector<TaskState> Job::states() const
{
    std::vector<TaskState> states(tasks());
    for (std::size_t n = 0; n < states.size(); ++n) {
        const fs::path result = mImpl->resultOf(phase(), n);
        if (phase() == JobPhase::Sample) states[n].points = (*mImpl->tiles)[n].points;
        if (const auto record = mImpl->doneBy(result)) {
            states[n].state = TaskState::State::Done;
            states[n].seconds = record->seconds;
            states[n].peakBytes = record->peakBytes;
            states[n].host = record->host;
        } else if (const std::string host = TaskMark::hostOf(Impl::markOf(result)); !host.empty()) {
            states[n].state = TaskState::State::Running;
            states[n].host = host;
        }
    }
    return states;
}

void Job::Impl::openField(Interrupter& progress) const
{
    fieldOnly();
    if (plan.coverage && !coverage) coverage = field->coverage(&progress);
    if (!plan.attributes.empty() && !attributes)
        attributes = field->attributes(plan.attributes, &progress);
}

/// Sample tile @a n, and look at it with what is around it.
void Job::Impl::sample(std::size_t n, const fs::path& file, TaskRecord& record,
                       Interrupter& progress) const
{
    openField(progress);
    const Tile& tile = (*tiles)[n];
    SampleSettings settings = plan.grid;
    openvdb::CoordBBox around = tile.box;
    // Whole leaves, in which the surface is that the band's last voxels are measured from.
    constexpr double kStencil = 4; ///< voxels beside a place on it [derived: cubic interpolation]
    around.expand(kBlockDim * int(std::ceil((settings.halfWidth + kStencil) / kBlockDim)));
    settings.region = boxOf(around, settings.lattice);
    const LevelSet part = sampleField(*field, settings, &progress);
    for (const CheckFinding& fault :
         check(part.grid(), kGradientTolerance, around, &progress).findings)
        record.faults.push_back(fault.what);
    record.voxels = activeVoxelsIn(part.grid(), tile.box);
    record.explained = explain(part, *field, boxOf(tile.box, settings.lattice), &progress);
    openvdb::GridCPtrVec grids{part.gridPtr()};
    if (coverage) grids.push_back(sampleCoverage(part, *coverage, &progress));
    if (attributes)
        for (const openvdb::GridBase::Ptr& grid : sampleAttributes(part, *attributes, &progress))
            grids.push_back(grid);
    progress.beginStage("write");
    writeAtomically(file, [&](const fs::path& temporary) {
        ArrayFileWriter arrays(temporary);
        for (std::size_t g = 0; g < grids.size(); ++g)
            saveLeaves(arrays, prefixOf(g), *grids[g], tile.box, progress);
        arrays.finish();
    });
    progress.endStage();
}

void Job::run(std::size_t n, Interrupter* interrupter) const
{
    Interrupter& progress = orSilent(interrupter);
    if (n >= tasks())
        throw UsageError(fmt::format("task {}: the phase has tasks 0 to {}", n, tasks() - 1));
    const fs::path result = mImpl->resultOf(phase(), n);
    if (mImpl->doneBy(result)) return;
    const auto start = std::chrono::steady_clock::now();
    const TaskMark mark(Impl::markOf(result));
    TaskRecord record;
    if (phase() == JobPhase::Fit)
        SpreadFit(mImpl->folder).fit(n, result, progress);
    else
        mImpl->sample(n, result, record, progress);
    record.plan = mImpl->plan.id;
    record.hash = contentHash(result, progress);
    record.host = TaskMark::thisHost();
    record.bytes = fs::file_size(result);
    record.peakBytes = peakResidentBytes();
    record.seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    // Somebody else may have done it meanwhile.
    if (const auto other = TaskRecord::read(Impl::recordOf(result));
        other && other->plan == record.plan && other->hash != record.hash)
        throw InputError(
            fmt::format("{}: {} made other bytes of it: one of the machines is damaged, "
                        "or its program is another. Remove {} once it is known which",
                        result.string(), other->host, Impl::recordOf(result).string()));
    record.write(Impl::recordOf(result));
}

/// @throws InputError unless all results of @a phase are there and sound.
void Job::Impl::requireAll(JobPhase phase, Interrupter& progress) const
{
    std::vector<std::size_t> missing, bad;
    for (std::size_t n = 0; n < tasksOf(phase); ++n) {
        progress.check();
        const fs::path result = resultOf(phase, n);
        if (!doneBy(result))
            missing.push_back(n);
        else if (!isSound(result, progress))
            bad.push_back(n);
    }
    const auto list = [](const std::vector<std::size_t>& tasks) {
        constexpr std::size_t kShown = 10; ///< tasks named [free: length of a message]
        const std::vector<std::size_t> shown(
            tasks.begin(), tasks.begin() + std::ptrdiff_t(std::min(tasks.size(), kShown)));
        return fmt::format("{}{}", fmt::join(shown, ", "), tasks.size() > kShown ? ", ..." : "");
    };
    if (!missing.empty())
        throw InputError(
            fmt::format("{}: {} of {} tasks are not done: {}. Run mpuvdb tile for them",
                        folder.string(), missing.size(), tasksOf(phase), list(missing)));
    if (!bad.empty())
        throw InputError(fmt::format("{}: {} results are damaged: {}. Drop them with mpuvdb status "
                                     "--retry, and run mpuvdb tile for them",
                                     folder.string(), bad.size(), list(bad)));
}

void Job::gather(Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    mImpl->requireAll(phase(), progress);
    if (phase() == JobPhase::Sample) return;
    requireFiles(mImpl->folder, mImpl->plan.files, progress);
    SpreadFit(mImpl->folder).join(mImpl->resultsOf(JobPhase::Fit), mImpl->fieldFile(), progress);
    progress.beginStage("tiles");
    const auto field = SpreadFit::open(mImpl->folder, mImpl->fieldFile());
    const TileList list{
        tilesOf(*field, mImpl->plan.grid, mImpl->plan.options.tileVoxels, progress),
        hashesOf(mImpl->folder, {mImpl->fieldFile().filename().string()}, progress)};
    writeTiles(mImpl->tilesFile(), mImpl->plan.id, list);
    mImpl->tiles = list.tiles;
    mImpl->fieldHash = list.field;
    progress.endStage();
}

std::size_t Job::dropDamaged(Interrupter* interrupter) const
{
    Interrupter& progress = orSilent(interrupter);
    std::size_t dropped = 0;
    for (std::size_t n = 0; n < tasks(); ++n) {
        const fs::path result = mImpl->resultOf(phase(), n);
        std::error_code ignored;
        if (!fs::exists(Impl::recordOf(result)) || mImpl->isSound(result, progress)) continue;
        fs::remove(Impl::recordOf(result), ignored);
        fs::remove(result, ignored);
        ++dropped;
    }
    return dropped;
}

/// The level set of all tiles.
PartedGrid Job::Impl::parted() const
{
    PartedGrid grid(plan.grid.lattice, plan.options.tileVoxels);
    for (std::size_t n = 0; n < tiles->size(); ++n)
        if (const ArrayFile file(resultOf(JobPhase::Sample, n)); hasLeaves(file, prefixOf(0)))
            grid.add(grid.cubeOf((*tiles)[n].box.min()), file);
    return grid;
}

/// The grids of @a region in @a tiles, of whose voxels none are held.
openvdb::GridPtrVec Job::Impl::joined(const std::vector<ArrayFile>& files, const LeafRegion& region,
                                      Interrupter& progress) const
{
    openvdb::GridPtrVec grids;
    while (files.front().has(prefixOf(grids.size()) + "head"))
        grids.push_back(gridOfLeaves(files, prefixOf(grids.size()), region, progress));
    for (const auto& [key, value] : plan.options.metadata)
        grids.front()->insertMeta(key, openvdb::StringMetadata(value));
    grids.front()->insertMeta("mpuvdb:max_error", openvdb::StringMetadata(fmt::format(
                                                      "{}", fieldOnly().statistics().maxError)));
    return grids;
}

/// What all tiles came to.
JobResult Job::Impl::result() const
{
    JobResult result;
    std::vector<std::pair<PointsExplained, std::uint64_t>> parts;
    for (const fs::path& tile : resultsOf(JobPhase::Sample)) {
        TaskRecord record = TaskRecord::read(recordOf(tile)).value_or(TaskRecord{});
        result.voxels += record.voxels;
        result.faults.insert(result.faults.end(), record.faults.begin(), record.faults.end());
        parts.emplace_back(std::move(record.explained), record.voxels);
    }
    result.explained =
        joinExplained(parts, fieldOnly().settings().points, plan.grid.lattice.voxelSize);
    return result;
}

/// @throws InputError unless all tiles are there and sound.
void Job::Impl::requireTiles(Interrupter& progress) const
{
    if (phase() == JobPhase::Fit)
        throw InputError(
            fmt::format("{}: the fit is not gathered yet: run mpuvdb gather", folder.string()));
    requireAll(JobPhase::Sample, progress);
    requireFiles(folder, plan.files, progress);
    requireFiles(folder, fieldHash, progress);
}

JobResult Job::merge(const fs::path& file, Interrupter* interrupter) const
{
    Interrupter& progress = orSilent(interrupter);
    mImpl->requireTiles(progress);
    progress.beginStage("merge");
    std::vector<ArrayFile> tiles;
    for (const fs::path& result : mImpl->resultsOf(JobPhase::Sample)) tiles.emplace_back(result);
    const openvdb::GridPtrVec grids = mImpl->joined(tiles, {}, progress);
    writeGrids(file, {grids.begin(), grids.end()}, &progress);
    return mImpl->result();
}

JobResult Job::mergeToFolder(const fs::path& folder, const SceneSettings& scene,
                             Interrupter* interrupter) const
{
    Interrupter& progress = orSilent(interrupter);
    mImpl->requireTiles(progress);
    FolderContent content{{}, mImpl->parted(), mImpl->plan.grid.halfWidth, {}, {}, {}, scene};
    content.about = {{"job", mImpl->plan.id}};
    content.levelSet = prefixOf(0);
    content.grids = [&](const std::vector<ArrayFile>& tiles, const LeafRegion& region) {
        return mImpl->joined(tiles, region, progress);
    };
    for (std::size_t n = 0; n < tasks(); ++n) {
        const fs::path file = mImpl->resultOf(JobPhase::Sample, n);
        const auto record = TaskRecord::read(Impl::recordOf(file));
        content.tiles.push_back(
            {(*mImpl->tiles)[n].box, record ? record->voxels : std::uint64_t(0)});
    }
    const std::vector<std::string> faults = writeTileFolder(folder, content, progress);
    JobResult result = mImpl->result();
    result.faults.insert(result.faults.end(), faults.begin(), faults.end());
    return result;
}

double Job::voxelSize() const
{
    return mImpl->plan.grid.lattice.voxelSize;
}

double Job::diagonal(Interrupter* interrupter) const
{
    Interrupter& progress = orSilent(interrupter);
    mImpl->requireTiles(progress);
    const std::vector<ArrayFile> tiles = mImpl->parted().files();
    if (tiles.empty()) return 0;
    const auto grid = gridOfLeaves(tiles, prefixOf(0), {}, progress);
    return voxelSize() * grid->evalActiveVoxelDim().asVec3d().length();
}

Mesh Job::mesh(std::uint64_t maxBytes, bool strict, Interrupter* interrupter) const
{
    Interrupter& progress = orSilent(interrupter);
    mImpl->requireTiles(progress);
    const MpuField& field = mImpl->fieldOnly();
    Mesh mesh = meshOfParts(mImpl->parted(), prefixOf(0), {&field, strict}, maxBytes, progress);
    if (!mImpl->plan.attributes.empty())
        addAttributes(mesh, *field.attributes(mImpl->plan.attributes, &progress), &progress);
    return mesh;
}

std::uint64_t Job::bytes() const
{
    std::uint64_t bytes = 0;
    for (std::size_t n = 0; n < mImpl->tasksOf(JobPhase::Sample); ++n)
        if (const auto record = mImpl->doneBy(mImpl->resultOf(JobPhase::Sample, n)))
            bytes += record->bytes;
    return bytes;
}

const std::vector<std::string>& Job::inputs() const
{
    return mImpl->plan.options.inputs;
}

} // namespace mpuvdb
