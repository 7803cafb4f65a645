#include "command_line.h"

#include "memory_limit.h"
#include "sequence.h"
#include "standard_output.h"
#include "suggest.h"

#include <mpuvdb/memory.h>

#include <algorithm>
#include <fmt/format.h>

namespace mpuvdb::command
{
namespace
{

const char* const kIntroduction = "mpuvdb: scattered points to correct OpenVDB level sets.\n"
                                  "Start with:  mpuvdb reconstruct scan.ply -o scan.vdb\n"
                                  "Help on a verb:  mpuvdb VERB --help";

const char* const kConventions =
    "Lengths are world units (0.002), voxels (1.5vx) or a part of the diagonal of the input's box "
    "(0.1%).\n"
    "Exit status: 0 ok, 1 internal error, 2 wrong usage, 3 bad input, 4 check failed or the input\n"
    "             not explained, 5 out of memory or voxels, 6 try again (disk\n"
    "             full, file system failing for a moment), 130 interrupted (143: SIGTERM).";

const char* const kCommonGroup = "Options of every verb";

void addSequenceOptions(CLI::App& app, CommonOptions& options)
{
    CLI::Option* const frames =
        app.add_option_function<std::string>(
               "--frames",
               [&options](const std::string& text) { options.frames = parseFrames(text); },
               "Run once for each of these frames: 7, 1-24, or 1-24x2 by steps. The frame's "
               "number\n"
               "takes the place of ####, %04d or $F4 wherever it stands: in inputs, outputs and\n"
               "values, such as in.####.vdb -o out.####.vdb. A frame that fails does not stop the\n"
               "others; the exit status is then the largest of theirs, and the report lists them")
            ->type_name("RANGE")
            ->group(kCommonGroup);
    app.add_option("--only", options.only, "Only this frame of --frames: a task of a render farm")
        ->type_name("N")
        ->needs(frames)
        ->group(kCommonGroup);
    app.add_flag("--skip-existing", options.skipExisting, "Skip frames whose outputs are all there")
        ->needs(frames)
        ->group(kCommonGroup);
    app.add_option("--jobs", options.jobs,
                   "Frames at the same time, each in a process of its own; they share --threads\n"
                   "and --max-memory evenly; default: 1")
        ->type_name("N")
        ->check(CLI::Range(1, 256).description(""))
        ->needs(frames)
        ->group(kCommonGroup);
    app.add_option(kTaskOption, options.task)->group(""); // for sequence.cpp, not for people
}

void addCommonOptions(CLI::App& app, CommonOptions& options)
{
    const char* const group = kCommonGroup;
    app.add_option("--threads", options.threads, "Threads to use; default: all")
        ->type_name("N")
        ->check(CLI::Range(1, 4096).description(""))
        ->group(group);
    app.add_option_function<std::string>(
           "--max-memory",
           [&options](const std::string& text) { options.maxBytes = parseSize(text); },
           "Memory limit beside the 30 MB of the program itself, such as 4G;\ndefault: 90 % of "
           "the machine's memory")
        ->type_name("SIZE")
        ->group(group);
    app.add_option("--progress", options.progress,
                   "auto, bar, json or none; auto: a bar on a terminal")
        ->type_name("STYLE")
        ->check(oneOf({"auto", "bar", "json", "none"}))
        ->group(group);
    app.add_option("--report", options.report,
                   "Write settings, results and times as JSON; - is standard output")
        ->type_name("FILE.json")
        ->group(group);
    app.add_flag("-q,--quiet", options.quiet, "Print warnings and errors only")->group(group);
    addSequenceOptions(app, options);
}

std::vector<std::string> optionNames(const CLI::App& app)
{
    std::vector<std::string> names;
    for (const CLI::Option* option : app.get_options())
        for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
    return names;
}

std::string didYouMean(const std::string& word, const std::vector<std::string>& known)
{
    const std::optional<std::string> meant = suggest(word, known);
    return meant ? fmt::format("; did you mean {}?", *meant) : std::string();
}

/// The error of an unknown word, which is the cause of others; none without one.
std::optional<std::string> unknownWord(const CLI::App& root)
{
    const std::vector<std::string> words = root.remaining(true);
    if (words.empty()) return {};
    const auto verbs = root.get_subcommands();
    const CLI::App& app = verbs.empty() ? root : *verbs.front();
    const auto isOption = [](const std::string& w) { return w.size() > 1 && w[0] == '-'; };
    const auto option = std::find_if(words.begin(), words.end(), isOption);
    if (verbs.empty() && !isOption(words.front())) {
        std::vector<std::string> names;
        for (const CLI::App* verb : root.get_subcommands({})) names.push_back(verb->get_name());
        return fmt::format("unknown verb '{}'{}", words.front(), didYouMean(words.front(), names));
    }
    if (option == words.end()) return fmt::format("unexpected argument '{}'", words.front());
    const std::string name = option->substr(0, option->find('='));
    const std::vector<std::string> known = optionNames(app);
    if (std::find(known.begin(), known.end(), name) != known.end())
        return fmt::format("{} stands before the verb: put it after the verb", name);
    return fmt::format("unknown option {}{}", name, didYouMean(name, known));
}

[[noreturn]] void throwUsage(const CLI::App& root, const std::string& parserMessage)
{
    const auto verbs = root.get_subcommands();
    const std::string who = verbs.empty() ? "mpuvdb" : "mpuvdb " + verbs.front()->get_name();
    const std::string what = unknownWord(root).value_or(parserMessage);
    throw UsageError(fmt::format("{}: {}\nSee {} --help", who, what, who));
}

/// Make -0.5 of -.5, which CLI11 takes for an option.
void leadWithDigit(std::string& word)
{
    if (word.size() > 2 && word[0] == '-' && word[1] == '.' && word[2] >= '0' && word[2] <= '9')
        word.insert(1, "0");
}

class Parser
{
public:
    Parser() : mRoot(kIntroduction, "mpuvdb")
    {
        mRoot.get_formatter()->column_width(32);
        mRoot.get_formatter()->label("SUBCOMMAND", "VERB");
        mRoot.set_help_flag("-h,--help", "Print this help and exit");
        mRoot.set_version_flag("--version", "mpuvdb " MPUVDB_VERSION, "Print the version and exit");
        mRoot.require_subcommand(1);
        mRoot.footer(kConventions);
        mOptions.maxBytes = defaultMemoryLimit();
        for (auto make :
             {makeReconstruct,  makeParticles,  makeVoxelize,    makeMesh,      makeUnion,
              makeIntersection, makeDifference, makeExclusiveOr, makeClip,      makeOffset,
              makeShell,        makeSmooth,     makeMorph,       makeTwistVerb, makeBendVerb,
              makeTaperVerb,    makeTransform,  makeResample,    makeFog,       makeIsosurface,
              makeComponents,   makeMerge,      makeSlice,       makeSample,    makeInfo,
              makeCheck,        makeRender,     makeMeasure,     makeAnalyze,   makePlan,
              makeTile,         makeGather,     makeStatus})
            add(make());
    }

    CommandLine parse(const std::vector<std::string>& words)
    {
        try {
            // CLI11 takes words without the program's name, the last one first.
            std::vector<std::string> reversed(words.rbegin(), words.rend() - 1);
            std::for_each(reversed.begin(), reversed.end(), leadWithDigit);
            mRoot.parse(std::move(reversed));
        } catch (const CLI::CallForVersion& version) {
            printText(std::string(version.what()) + "\n");
            return {};
        } catch (const CLI::CallForHelp&) {
            printText(mRoot.help());
            return {};
        } catch (const CLI::ParseError& error) {
            throwUsage(mRoot, words.size() < 2 ? "the verb is missing. Give a verb" : error.what());
        } catch (const UsageError& error) {
            throwUsage(mRoot, error.what());
        }
        const CLI::App* const chosen = mRoot.get_subcommands().front();
        const auto named = [&](const auto& verb) {
            return verb->text().name == chosen->get_name();
        };
        const auto verb = std::find_if(mVerbs.begin(), mVerbs.end(), named);
        return {std::move(*verb), mOptions};
    }

private:
    void add(std::unique_ptr<Verb> verb)
    {
        const VerbText text = verb->text();
        CLI::App& app = *mRoot.add_subcommand(text.name, text.summary);
        app.group("Verbs");
        verb->addOptions(app);
        addCommonOptions(app, mOptions);
        app.footer(std::string("Examples:\n") + text.examples + "\n" + kConventions);
        mVerbs.push_back(std::move(verb));
    }

    CLI::App mRoot;
    CommonOptions mOptions;
    std::vector<std::unique_ptr<Verb>> mVerbs;
};

} // namespace

CLI::Option* addLength(CLI::App& app, const std::string& name, std::optional<Length>& value,
                       const std::string& description)
{
    const auto parse = [name, &value](const std::string& text) {
        try {
            value = Length::parse(text);
        } catch (const UsageError& error) {
            throw UsageError(fmt::format("{}: {}", name, error.what()));
        }
    };
    return app.add_option_function<std::string>(name, parse, description)->type_name("LENGTH");
}

CLI::Option* addUpAxis(CLI::App& app, UpAxis& up, const std::string& help)
{
    return app
        .add_option_function<std::string>(
            "--up", [&up](const std::string& axis) { up = axis == "z" ? UpAxis::Z : UpAxis::Y; },
            help)
        ->type_name("y|z")
        ->check(oneOf({"y", "z"}));
}

CLI::Validator oneOf(const std::vector<std::string>& words)
{
    return CLI::IsMember(words).description("");
}

CLI::Option* addGridName(CLI::App& app, std::string& value)
{
    return app
        .add_option("--grid", value, "Name of the grid; default: surface, or the only level set")
        ->type_name("NAME");
}

CommandLine parseCommandLine(const std::vector<std::string>& words)
{
    return Parser().parse(words);
}

} // namespace mpuvdb::command
