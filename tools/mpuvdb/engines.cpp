#include "engines.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>
#include <fstream>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <vector>

namespace mpuvdb::command
{
namespace
{

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

/// @a text as one word of a shell.
std::string quoted(const std::string& text)
{
    std::string word = "'";
    for (const char c : text) word += c == '\'' ? "'\\''" : std::string(1, c);
    return word + "'";
}

/// The path of the running program.
std::string program()
{
    std::error_code error;
    const fs::path path = fs::read_symlink("/proc/self/exe", error);
    return error ? "mpuvdb" : path.string();
}

void writeText(const fs::path& file, const std::string& text)
{
    std::ofstream out(file, std::ios::binary | std::ios::trunc);
    out << text;
    out.close();
    if (!out) throw IoError(fmt::format("{}: cannot be written", file.string()));
}

/// Whether the result is a folder of tiles: all that is not named as a .vdb file.
bool isFolder(const EngineJob& job)
{
    return job.output.extension() != ".vdb";
}

/// What the last step is told to write: with / at its end for a folder.
std::string outputOf(const EngineJob& job)
{
    return isFolder(job) ? (job.output / "").string() : job.output.string();
}

/// The output as Snakemake calls it: it takes no / at the end of a folder.
std::string snakemakeOutput(const EngineJob& job)
{
    const std::string text = outputOf(job);
    return Json(isFolder(job) ? text.substr(0, text.size() - 1) : text).dump();
}

/// The commands of a job, as words of a shell.
struct Commands {
    std::string tile, gather, merge;

    explicit Commands(const EngineJob& job)
    {
        const std::string mpuvdb = quoted(program()), folder = quoted(job.folder.string());
        const std::string limit =
            job.maxBytes > 0 ? fmt::format(" --max-memory {}M", job.maxBytes >> 20) : "";
        tile = fmt::format("{} tile {}{} --progress none", mpuvdb, folder, limit);
        gather = fmt::format("{} gather {} --progress none", mpuvdb, folder);
        merge =
            fmt::format("{} merge {} -o {} --progress none", mpuvdb, folder, quoted(outputOf(job)));
    }
};

/// A shell's lines that run @a command, and run it again if a signal ended it, or a disk or a file
/// system that may recover (exit status 6).
std::string retried(const std::string& command)
{
    return fmt::format("for attempt in 1 2 3; do\n    {}\n    status=$?\n"
                       "    [ \"$status\" -eq 6 ] || [ \"$status\" -gt 128 ] || break\n"
                       "    sleep \"$attempt\"\ndone\nexit \"$status\"\n",
                       command);
}

/// Arrays for the two phases, and what joins them, by dependencies.
std::string writeSlurm(const EngineJob& job)
{
    const Commands commands(job);
    const fs::path folder = job.folder / "slurm";
    fs::create_directories(folder);
    const std::string at = quoted(folder.string());
    const std::string memory =
        job.maxBytes > 0 ? fmt::format("#SBATCH --mem={}M\n", (job.maxBytes >> 20) + 64) : "";
    const auto script = [&](const char* name, const std::string& command) {
        return fmt::format("#!/bin/sh\n#SBATCH --job-name=mpuvdb-{}\n#SBATCH --requeue\n"
                           "#SBATCH --open-mode=append\n{}{}",
                           name, memory, retried(command));
    };
    writeText(folder / "tile.sh",
              script("tile", fmt::format("{} --threads \"${{SLURM_CPUS_PER_TASK:-1}}\" "
                                         "\"$SLURM_ARRAY_TASK_ID\" --every {}",
                                         commands.tile, job.slots)));
    writeText(folder / "gather.sh", script("gather", commands.gather));
    writeText(folder / "merge.sh", script("merge", commands.merge));
    writeText(
        folder / "submit.sh",
        fmt::format(
            "#!/bin/sh\n# Options of sbatch, such as a partition, may follow the name of this "
            "script.\nset -e\ncd {0}\n"
            "fit=$(sbatch --parsable --array=0-{1} \"$@\" tile.sh)\n"
            "gather=$(sbatch --parsable -d afterok:\"$fit\" --kill-on-invalid-dep=yes \"$@\" "
            "gather.sh)\n"
            "tiles=$(sbatch --parsable --array=0-{1} -d afterok:\"$gather\" "
            "--kill-on-invalid-dep=yes \"$@\" tile.sh)\n"
            "sbatch --parsable -d afterok:\"$tiles\" --kill-on-invalid-dep=yes \"$@\" "
            "merge.sh\n",
            at, job.slots - 1));
    return "sh " + quoted((folder / "submit.sh").string());
}

std::string writeParallel(const EngineJob& job)
{
    const Commands commands(job);
    const fs::path script = job.folder / "parallel.sh";
    const auto phase = [&](const char* log) {
        return fmt::format("parallel \"$@\" --joblog {} --resume-failed --retries 3 {} {{}} "
                           "--every {} ::: $(seq 0 {})\n",
                           quoted((job.folder / log).string()), quoted(commands.tile), job.slots,
                           job.slots - 1);
    };
    writeText(script,
              "#!/bin/sh\n# Options of parallel, such as -j 4 or --sshloginfile, may follow the "
              "name of this script.\nset -e\n" +
                  phase("fit.joblog") + commands.gather + "\n" + phase("tiles.joblog") +
                  commands.merge + "\n");
    return "sh " + quoted(script.string());
}

std::string writeSnakemake(const EngineJob& job)
{
    const Commands commands(job);
    const fs::path file = job.folder / "Snakefile";
    const auto shell = [](const std::string& command) {
        std::string text;
        for (const char c : command)
            text += c == '{' ? "{{" : c == '}' ? "}}" : c == '"' ? "\\\"" : std::string(1, c);
        return text;
    };
    const auto tiles = [&](const char* rule, const char* mark, const std::string& after) {
        return fmt::format("rule {0}:\n{1}    output: touch(\"marks/{2}/{{n}}\")\n"
                           "    shell: \"{3} {{wildcards.n}} --every {4}\"\n\n",
                           rule, after, mark, shell(commands.tile), job.slots);
    };
    writeText(
        file,
        fmt::format("workdir: {0}\n\nrule all:\n    input: {1}\n\n",
                    Json(job.folder.string()).dump(), snakemakeOutput(job)) +
            tiles("fit", "fit", "") +
            fmt::format("rule gather:\n    input: expand(\"marks/fit/{{n}}\", n=range({0}))\n"
                        "    output: touch(\"marks/gathered\")\n    shell: \"{1}\"\n\n",
                        job.slots, shell(commands.gather)) +
            tiles("tiles", "tiles", "    input: \"marks/gathered\"\n") +
            fmt::format("rule merge:\n    input: expand(\"marks/tiles/{{n}}\", n=range({0}))\n"
                        "    output: {1}\n    shell: \"{2}\"\n",
                        job.slots,
                        isFolder(job) ? "directory(" + snakemakeOutput(job) + ")"
                                      : snakemakeOutput(job),
                        shell(commands.merge)));
    return "snakemake -s " + quoted(file.string()) + " --cores all --retries 3";
}

/// A template of Open Job Description, 2023-09, as JSON.
std::string writeOpenJd(const EngineJob& job)
{
    const std::string mpuvdb = program(), folder = job.folder.string();
    const auto action = [&](std::vector<std::string> arguments) {
        return Json{{"actions",
                     {{"onRun",
                       {{"command", mpuvdb},
                        {"args", std::move(arguments)},
                        {"cancelation",
                         {{"mode", "NOTIFY_THEN_TERMINATE"}, {"notifyPeriodInSeconds", 5}}}}}}}};
    };
    const auto step = [&](const char* name, const char* after, Json script) {
        Json made = {{"name", name}};
        if (after) made["dependencies"] = Json::array({{{"dependsOn", after}}});
        if (job.maxBytes > 0)
            made["hostRequirements"] = {
                {"amounts", Json::array({{{"name", "amount.worker.memory"},
                                          {"min", (job.maxBytes >> 20) + 64}}})}};
        made["script"] = std::move(script);
        return made;
    };
    const auto tiles = [&](const char* name, const char* after) {
        Json made = step(name, after,
                         action({"tile", folder, "{{Task.Param.Slot}}", "--every",
                                 std::to_string(job.slots), "--progress", "none"}));
        made["parameterSpace"] = {{"taskParameterDefinitions",
                                   Json::array({{{"name", "Slot"},
                                                 {"type", "INT"},
                                                 {"range", fmt::format("0-{}", job.slots - 1)}}})}};
        return made;
    };
    const Json text = {
        {"specificationVersion", "jobtemplate-2023-09"},
        {"name", "mpuvdb"},
        {"steps",
         Json::array(
             {tiles("Fit", nullptr),
              step("Gather", "Fit", action({"gather", folder, "--progress", "none"})),
              tiles("Tiles", "Gather"),
              step("Merge", "Tiles",
                   action({"merge", folder, "-o", outputOf(job), "--progress", "none"}))})}};
    const fs::path file = job.folder / "openjd.json";
    writeText(file, text.dump(2) + "\n");
    return "openjd run " + quoted(file.string());
}

std::string writeList(const EngineJob& job)
{
    const Commands commands(job);
    std::string tiles;
    for (int n = 0; n < job.slots; ++n)
        tiles += fmt::format("{} {} --every {}\n", commands.tile, n, job.slots);
    writeText(job.folder / "1-fit.txt", tiles);
    writeText(job.folder / "2-gather.txt", commands.gather + "\n");
    writeText(job.folder / "3-tiles.txt", tiles);
    writeText(job.folder / "4-merge.txt", commands.merge + "\n");
    return fmt::format("the commands in {}, file after file; those of one file in any order",
                       quoted((job.folder / "[1-4]-*.txt").string()));
}

} // namespace

std::string writeEngine(const std::string& engine, const EngineJob& job)
{
    const std::map<std::string, std::function<std::string(const EngineJob&)>> writers = {
        {"slurm", writeSlurm},
        {"parallel", writeParallel},
        {"snakemake", writeSnakemake},
        {"openjd", writeOpenJd},
        {"list", writeList}};
    return writers.at(engine)(job);
}

} // namespace mpuvdb::command
