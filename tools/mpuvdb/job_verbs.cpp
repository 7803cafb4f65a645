// mpuvdb plan, tile, gather, status: reconstructions in tasks, on one machine or on many.
#include "job_verbs.h"
#include "cloud_options.h"
#include "describe.h"
#include "engines.h"
#include "presets.h"
#include "verb.h"

#include "files/content_hash.h"

#include <mpuvdb/error.h>
#include <mpuvdb/farm.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/memory.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <filesystem>
#include <fmt/format.h>
#include <unistd.h>

namespace mpuvdb::command
{
namespace
{

namespace fs = std::filesystem;

class PlanVerb final : public Verb
{
public:
    VerbText text() const override
    {
        return {
            "plan", "Plan a reconstruction in tasks: out of core, or on many machines",
            "  mpuvdb plan scan.ply --job job/ --voxel-size 0.002\n"
            "  mpuvdb tile job/ && mpuvdb gather job/ && mpuvdb tile job/\n"
            "  mpuvdb merge job/ -o scan.vdb\n"
            "      The same bytes as mpuvdb reconstruct, a tile at a time.\n"
            "  mpuvdb plan scans/*.las --job job/ --voxel-size 0.02 --engine slurm -o city.vdb\n"
            "  sh job/slurm/submit.sh\n"
            "      All tasks and what joins them, as jobs of Slurm.\n"};
    }

    void addOptions(CLI::App& app) override
    {
        mCloud.addInputs(app);
        app.add_option("--job", mFolder, "The job's folder, which all machines have to see")
            ->required()
            ->type_name("FOLDER");
        app.add_option(
               "-o,--output", mOutput,
               "What the engine's last step writes: a .vdb file, or a folder of tiles, whose\n"
               "name ends in /; default: surface.vdb in the job's folder")
            ->type_name("OUT.vdb|OUT/");
        app.add_option("--engine", mEngine,
                       "Write what an engine needs to run the job: scripts for Slurm or GNU\n"
                       "parallel, a Snakefile, a template of Open Job Description, or a list of\n"
                       "commands for anything else")
            ->type_name("slurm|parallel|snakemake|openjd|list")
            ->check(oneOf({"slurm", "parallel", "snakemake", "openjd", "list"}));
        app.add_option("--slots", mSlots,
                       "Tasks that an engine sees of each phase, up to 1000; each does several\n"
                       "tiles in turn")
            ->type_name("N")
            ->check(CLI::Range(1, 1000).description(""))
            ->capture_default_str();
        app.add_option("--tile-voxels", mTileVoxels,
                       "Edge of a tile, voxels, a multiple of 128: its memory grows with the\n"
                       "square. Default: 512, or 256 or 128 where --max-memory asks for it")
            ->type_name("N");
        app.add_option("--part-points", mPartPoints,
                       "Points of a part of the fit, about. Default: 4 million, or fewer")
            ->type_name("N")
            ->check(CLI::Range(std::size_t(1), std::size_t(1) << 32).description(""));
        addPreset(app, mCloud.preset);
        addAttributes(app, mCloud.attributes,
                      "What of the points goes to grids beside the level set, as mpuvdb "
                      "reconstruct\nmakes them: each process looks at all points for them");
        app.add_flag("--coverage", mCloud.coverage,
                     "Write a grid 'coverage' beside the level set: 1 where data support the\n"
                     "surface, 0 where it is invented; each process looks at all points for it");
        mCloud.addTo(app);
        app.callback([this, &app] { mPresetOptions = applyPreset(app, mCloud.preset); });
    }

    ExitCode run(Session& session) override
    {
        if (!mCloud.preset.empty())
            session.note(fmt::format("preset      {}: {}", mCloud.preset, mPresetOptions));
        session.checkFiles({}, mCloud.inputs);
        checkDistinct({{"-o", mOutput, {}}}, mCloud.inputs);
        session.openScratch(mFolder);
        Interrupter* const interrupter = &session.progress();
        PreparedPoints prepared = preparePoints(mCloud.read(session), mCloud.options, interrupter);
        mCloud.describeCleaning(session, prepared.report);
        mCloud.describeSettings(session, prepared.report);
        mJob.build = buildId();
        mJob.inputs = mCloud.inputs;
        mJob.metadata = metadataOf(prepared.report);
        CloudOptions::summarizeSettings(session, prepared.report);
        foresee(session, prepared);
        Job::plan(mFolder, std::move(prepared), mJob, interrupter);
        const Job job(mFolder, mJob.build);
        const std::string output =
            mOutput.empty() ? (fs::path(mFolder) / "surface.vdb").string() : mOutput;
        session.note(fmt::format("job         {}: the fit in {} parts; its tiles are listed when "
                                 "they are gathered",
                                 mFolder, job.tasks()));
        session.report()["job"]["folder"] = mFolder;
        session.report()["job"]["parts"] = job.tasks();
        if (!mEngine.empty())
            session.note("start       " +
                         writeEngine(mEngine, {fs::absolute(mFolder), fs::absolute(output), mSlots,
                                               limitOf(session)}));
        return ExitCode::Ok;
    }

private:
    /// Chooses the tiles, and says what the job comes to.
    void foresee(Session& session, const PreparedPoints& points)
    {
        if (mTileVoxels) requireTile(*mTileVoxels);
        const ReconstructionEstimate run = estimate(points, false, &session.progress());
        const JobEstimate job =
            estimateJob(points, run, mTileVoxels, session.options().maxBytes, &session.progress());
        mJob.tileVoxels = job.tileVoxels;
        mJob.partPoints = mPartPoints.value_or(job.partPoints);
        session.report()["job"] = {
            {"tile_voxels", job.tileVoxels}, {"tiles", job.tiles},
            {"task_bytes", job.taskBytes},   {"merge_bytes", job.mergeBytes},
            {"disk_bytes", job.diskBytes},   {"cpu_seconds", job.cpuSeconds}};
        session.note(
            fmt::format("tiles       about {} of {} voxels, of {} of memory at most, and {} "
                        "to merge them; all tasks take about {:.0f} s of CPU, and {} on "
                        "disk",
                        job.tiles, job.tileVoxels, sizeText(job.taskBytes),
                        sizeText(job.mergeBytes), job.cpuSeconds, sizeText(job.diskBytes)));
        const fs::path disk = existingFolder(mFolder);
        std::error_code error;
        const std::uintmax_t free = fs::space(disk, error).available;
        if (!error && free < job.diskBytes)
            session.warn(fmt::format("{}: {} are free, and the job takes about {}: free some "
                                     "space, or put it on another disk",
                                     disk.string(), sizeText(free), sizeText(job.diskBytes)));
    }

    /// Memory of a task, bytes, if it was given; 0: that of the machine that does it.
    static std::uint64_t limitOf(const Session& session)
    {
        const std::uint64_t given = session.options().maxBytes;
        return given == defaultMemoryLimit() ? 0 : given;
    }

    CloudOptions mCloud;
    std::string mPresetOptions; ///< what the preset set
    std::string mFolder, mOutput, mEngine;
    int mSlots = 64;
    std::optional<int> mTileVoxels;
    std::optional<std::size_t> mPartPoints;
    JobOptions mJob;
};

/// The number of this task in what an engine calls it: variables with the number of the first task.
std::optional<std::size_t> taskOfEngine()
{
    constexpr std::array<std::pair<const char*, std::size_t>, 6> kVariables = {
        {{"SLURM_ARRAY_TASK_ID", 0},
         {"JOB_COMPLETION_INDEX", 0},
         {"AWS_BATCH_JOB_ARRAY_INDEX", 0},
         {"PBS_ARRAY_INDEX", 0},
         {"SGE_TASK_ID", 1},
         {"CUE_IFRAME", 0}}};
    for (const auto& [name, first] : kVariables) {
        const char* const value = std::getenv(name);
        char* end = nullptr;
        if (!value) continue;
        const unsigned long long n = std::strtoull(value, &end, 10);
        if (end != value && *end == '\0' && n >= first) return std::size_t(n) - first;
    }
    return std::nullopt;
}

class TileVerb final : public Verb
{
public:
    VerbText text() const override
    {
        return {"tile", "Do tasks of a job",
                "  mpuvdb tile job/\n"
                "      All that are not done yet.\n"
                "  mpuvdb tile job/ 17\n"
                "      One. Array jobs of Slurm, PBS, Grid Engine, Kubernetes, AWS Batch and\n"
                "      OpenCue give the number in the environment.\n"
                "  mpuvdb tile job/ 3 --every 64\n"
                "      3, 67, 131 and so on, as far as there are tasks.\n"};
    }

    void addOptions(CLI::App& app) override
    {
        app.add_option("job", mFolder, "The job's folder")->required()->type_name("JOB");
        app.add_option("task", mTask, "The task, from 0")
            ->type_name("N")
            ->check(CLI::Range(std::size_t(0), std::size_t(1) << 32).description(""));
        app.add_option("--every", mEvery, "Do every Nth task from that one on")
            ->type_name("N")
            ->check(CLI::Range(std::size_t(1), std::size_t(1) << 32).description(""));
    }

    ExitCode run(Session& session) override
    {
        session.checkFiles({}, {});
        session.openScratch(mFolder);
        const Job job(mFolder, buildId());
        if (!mTask) mTask = taskOfEngine();
        if (mEvery && !mTask)
            throw UsageError("--every needs the first task, or an engine that numbers it");
        std::size_t done = 0;
        const auto run = [&](std::size_t task) {
            job.run(task, &session.progress());
            ++done;
        };
        if (mTask && !mEvery)
            run(*mTask);
        else
            for (std::size_t n = mTask.value_or(0); n < job.tasks(); n += mEvery.value_or(1))
                run(n);
        session.note(fmt::format("done        {} tasks of {} ({})", done, job.tasks(),
                                 job.phase() == JobPhase::Fit ? "parts of the fit" : "tiles"));
        session.report()["tasks"] = done;
        return ExitCode::Ok;
    }

private:
    std::string mFolder;
    std::optional<std::size_t> mTask, mEvery;
};

class GatherVerb final : public Verb
{
public:
    VerbText text() const override
    {
        return {"gather", "Join what a phase of a job made",
                "  mpuvdb gather job/\n"
                "      After all parts of the fit: the field, and the list of tiles.\n"};
    }

    void addOptions(CLI::App& app) override
    {
        app.add_option("job", mFolder, "The job's folder")->required()->type_name("JOB");
    }

    ExitCode run(Session& session) override
    {
        session.checkFiles({}, {});
        session.openScratch(mFolder);
        Job job(mFolder, buildId());
        job.gather(&session.progress());
        session.note(fmt::format("job         {} tiles", job.tasks()));
        session.report()["tiles"] = job.tasks();
        return ExitCode::Ok;
    }

private:
    std::string mFolder;
};

class StatusVerb final : public Verb
{
public:
    VerbText text() const override
    {
        return {"status", "How far a job is",
                "  mpuvdb status job/\n"
                "  mpuvdb status job/ --retry\n"
                "      Damaged results are dropped, so that their tasks are done again.\n"};
    }

    void addOptions(CLI::App& app) override
    {
        app.add_option("job", mFolder, "The job's folder")->required()->type_name("JOB");
        app.add_flag("--json", mJson, "Print JSON on standard output");
        app.add_flag("--retry", mRetry, "Drop damaged results; all are read for that");
    }

    ExitCode run(Session& session) override
    {
        session.checkFiles({}, {});
        const Job job(mFolder, "");
        if (mRetry)
            session.note(fmt::format("dropped     {} damaged results",
                                     job.dropDamaged(&session.progress())));
        const nlohmann::ordered_json status = statusOf(job);
        session.report()["status"] = status;
        if (mJson)
            session.printJson(status);
        else
            print(session, status);
        return ExitCode::Ok;
    }

private:
    static nlohmann::ordered_json statusOf(const Job& job)
    {
        std::size_t done = 0, running = 0;
        double seconds = 0, slowest = 0;
        std::uint64_t peak = 0;
        for (const TaskState& task : job.states()) {
            done += task.state == TaskState::State::Done;
            running += task.state == TaskState::State::Running;
            seconds += task.seconds;
            slowest = std::max(slowest, task.seconds);
            peak = std::max(peak, task.peakBytes);
        }
        const double mean = done > 0 ? seconds / double(done) : 0;
        return {{"phase", job.phase() == JobPhase::Fit ? "fit" : "sample"},
                {"tasks", job.tasks()},
                {"done", done},
                {"running", running},
                {"waiting", job.tasks() - done - running},
                {"seconds", seconds},
                {"slowest_seconds", slowest},
                {"seconds_left", mean * double(job.tasks() - done)},
                {"peak_bytes", peak}};
    }

    static void print(Session& session, const nlohmann::ordered_json& status)
    {
        session.note(
            fmt::format("phase       {}: {} of {} tasks done, {} running, {} waiting",
                        status["phase"].get<std::string>(), status["done"].get<std::size_t>(),
                        status["tasks"].get<std::size_t>(), status["running"].get<std::size_t>(),
                        status["waiting"].get<std::size_t>()));
        session.note(
            fmt::format("time        {:.1f} s of tasks, the slowest {:.1f} s; about {:.0f} "
                        "s are left for one machine; peak memory {}",
                        status["seconds"].get<double>(), status["slowest_seconds"].get<double>(),
                        status["seconds_left"].get<double>(),
                        sizeText(status["peak_bytes"].get<std::uint64_t>())));
    }

    std::string mFolder;
    bool mJson = false, mRetry = false;
};

} // namespace

std::string buildId()
{
    return fmt::format("{} {}", MPUVDB_VERSION, contentHash("/proc/self/exe", Interrupter{}));
}

ExitCode reconstructInTasks(Session& session, PreparedPoints&& points,
                            const ReconstructionEstimate& estimate,
                            const std::map<std::string, std::string>& metadata,
                            const std::string& file)
{
    /// A folder that goes with this object.
    struct Folder {
        fs::path path;
        ~Folder()
        {
            std::error_code ignored;
            fs::remove_all(path, ignored);
        }
    };
    const Folder folder{fmt::format("{}.{}.job", file, ::getpid())};
    Interrupter* const interrupter = &session.progress();
    const JobEstimate tasks =
        estimateJob(points, estimate, std::nullopt, session.options().maxBytes, interrupter);
    if (tasks.mergeBytes > session.options().maxBytes)
        throw LimitError(fmt::format("all leaves of the level set would take about {} of memory in "
                                     "the end, and the limit is "
                                     "{}: raise --max-memory, or use larger voxels",
                                     sizeText(tasks.mergeBytes),
                                     sizeText(session.options().maxBytes)));
    JobOptions options;
    options.build = buildId();
    options.metadata = metadata;
    options.tileVoxels = tasks.tileVoxels;
    options.partPoints = tasks.partPoints;
    Job::plan(folder.path, std::move(points), options, interrupter);
    Job job(folder.path, options.build);
    for (const JobPhase phase : {JobPhase::Fit, JobPhase::Sample}) {
        for (std::size_t n = 0; n < job.tasks(); ++n) job.run(n, interrupter);
        if (phase == JobPhase::Fit) job.gather(interrupter);
    }
    session.note(fmt::format("out of core {} tiles of {} voxels, as the memory limit is below what "
                             "it takes at once",
                             job.tasks(), options.tileVoxels));
    return describeJob(session, job.merge(file, interrupter), file);
}

ExitCode describeJob(Session& session, const JobResult& result, const std::string& file)
{
    session.progress().endStage();
    const PointsExplained& e = result.explained;
    session.report()["explained"] = toJson(e);
    session.report()["grid"] = {{"active_voxels", result.voxels}};
    session.note(fmt::format("grid        {} active voxels: {}", result.voxels, file));
    session.note(fmt::format("explained   {:.2f} % of the points within {:.3g} of the surface, the "
                             "farthest {}; {:.2g} % of the surface has none near",
                             100 * e.within, e.limit, farthestText(e), 100 * e.unsupported));
    session.note("time        " + session.timesText());
    for (const std::string& fault : result.faults) session.warn(fmt::format("{}: {}", file, fault));
    for (const std::string& finding : e.findings)
        session.warn(fmt::format("{}: {}", file, finding));
    return result.faults.empty() && e.findings.empty() ? ExitCode::Ok : ExitCode::CheckFailed;
}

std::unique_ptr<Verb> makePlan()
{
    return std::make_unique<PlanVerb>();
}

std::unique_ptr<Verb> makeTile()
{
    return std::make_unique<TileVerb>();
}

std::unique_ptr<Verb> makeGather()
{
    return std::make_unique<GatherVerb>();
}

std::unique_ptr<Verb> makeStatus()
{
    return std::make_unique<StatusVerb>();
}

} // namespace mpuvdb::command
