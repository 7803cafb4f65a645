#include "session.h"

#include "memory_limit.h"
#include "standard_output.h"

#include "files/atomic_file.h"
#include <mpuvdb/error.h>
#include <mpuvdb/io.h>
#include <mpuvdb/memory.h>

#include <algorithm>
#include <fmt/format.h>
#include <fstream>
#include <unistd.h>

namespace mpuvdb::command
{
namespace
{

ProgressStyle styleOf(const CommonOptions& options)
{
    if (options.progress == "bar") return ProgressStyle::Bar;
    if (options.progress == "json") return ProgressStyle::JsonLines;
    const bool watched = options.progress == "auto" && !options.quiet && isatty(STDERR_FILENO);
    return watched ? ProgressStyle::Bar : ProgressStyle::None;
}

enum class Layout { Lines, OneLine };

/// File names need not be UTF-8; JSON has to be.
std::string textOf(const nlohmann::ordered_json& json, Layout layout)
{
    return json.dump(layout == Layout::Lines ? 2 : -1, ' ', false,
                     nlohmann::ordered_json::error_handler_t::replace) +
           "\n";
}

} // namespace

Session::Session(std::string verb, const CommonOptions& options, Purpose purpose)
    : mPurpose(purpose), mVerb(std::move(verb)), mOptions(options), mDisplay(styleOf(options)),
      mProgress([this](const std::string& stage, double f) { mDisplay.show(stage, f); })
{
    if (purpose == Purpose::NameFiles) return;
    limitMemory(options.maxBytes);
    if (options.threads) {
        mThreads = std::make_unique<tbb::global_control>(
            tbb::global_control::max_allowed_parallelism, std::size_t(*options.threads));
    }
}

std::uint64_t Session::bytesLeft() const
{
    if (mOptions.maxBytes == 0) return 0;
    if (mHeld >= mOptions.maxBytes)
        throw LimitError(fmt::format("the input and the command itself take {}, and --max-memory "
                                     "is {}. Give more",
                                     sizeText(mHeld), sizeText(mOptions.maxBytes)));
    return mOptions.maxBytes - mHeld;
}

void Session::openScratch(const std::filesystem::path& path)
{
    mScratch = std::make_unique<ScratchMemory>(existingFolder(path), mOptions.maxBytes);
}

bool Session::isShared(const std::string& option) const
{
    if (!mOptions.frame) return false;
    const std::vector<std::string>& shared = mOptions.frame->shared;
    return std::find(shared.begin(), shared.end(), option) != shared.end();
}

void Session::checkFiles(const std::vector<Output>& outputs, const std::vector<std::string>& inputs)
{
    const Output report{"--report", mOptions.report, {}, true};
    std::vector<Output> all{report};
    all.insert(all.end(), outputs.begin(), outputs.end());
    checkDistinct(all, inputs);
    if (mPurpose == Purpose::NameFiles) {
        for (const Output& output : all) checkForm(output);
        throw NamedFiles{outputs, inputs};
    }
    checkOutput(report);
    mReportFile = mOptions.report; // errors are reported there from now on
    for (const Output& output : outputs) checkOutput(output);
}

void Session::note(const std::string& message)
{
    if (!mOptions.quiet) mDisplay.print(message);
}

void Session::printJson(const nlohmann::ordered_json& json) const
{
    if (!mOptions.frame) return printText(textOf(json, Layout::Lines));
    nlohmann::ordered_json ofFrame{{"frame", mOptions.frame->number}};
    ofFrame.update(json);
    printText(textOf(ofFrame, Layout::OneLine));
}

void Session::warn(const std::string& message)
{
    mDisplay.print(fmt::format("mpuvdb {}: warning: {}", mVerb, message));
    mReport["warnings"].push_back(message);
}

void Session::fail(const char* type, const std::string& message)
{
    // The library's messages begin with its function, which often has the verb's name.
    const std::string verb = mVerb + ": ";
    mDisplay.print("mpuvdb " + (message.rfind(verb, 0) == 0 ? message : verb + message));
    mReport["error"] = {{"type", type}, {"message", message}};
}

std::string Session::timesText() const
{
    std::vector<StageTime> together; // stages of one name, in the order of their first ones
    double total = 0;
    std::uint64_t peak = 0;
    for (const StageTime& stage : mProgress.stages()) {
        const auto known = std::find_if(together.begin(), together.end(),
                                        [&](const StageTime& s) { return s.name == stage.name; });
        if (known == together.end())
            together.push_back(stage);
        else
            known->seconds += stage.seconds;
        total += stage.seconds;
        peak = std::max(peak, stage.peakBytes);
    }
    std::string text;
    for (const StageTime& stage : together)
        text += fmt::format("{} {:.2f} s, ", stage.name, stage.seconds);
    return fmt::format("{}together {:.2f} s; peak memory {}", text, total, sizeText(peak));
}

void Session::writeReport()
{
    mProgress.endStage();
    mDisplay.clear();
    auto stages = nlohmann::ordered_json::array();
    for (const StageTime& stage : mProgress.stages()) {
        stages.push_back({{"name", stage.name},
                          {"seconds", stage.seconds},
                          {"cpu_seconds", stage.cpuSeconds},
                          {"peak_bytes", stage.peakBytes}});
    }
    mReport["stages"] = stages;
    if (mReportFile.empty() || isShared("--report")) return;
    const std::string text = reportText();
    if (mReportFile == "-") return printText(text);
    writeAtomically(mReportFile, [&](const std::filesystem::path& file) {
        std::ofstream out(file, std::ios::binary);
        out << text << std::flush;
        if (!out) {
            throw IoError(fmt::format(
                "{}: cannot be written. Free some space, or write to another disk", mReportFile));
        }
    });
}

std::string Session::reportText() const
{
    return textOf(mReport, Layout::Lines);
}

} // namespace mpuvdb::command
