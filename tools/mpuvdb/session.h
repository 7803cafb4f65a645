// The progress, messages, report and limits of a run.
#pragma once
#include "frames.h"
#include "output_check.h"
#include "progress_display.h"
#include "scratch_memory.h"

#include <mpuvdb/interrupter.h>

#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <tbb/global_control.h>

namespace mpuvdb::command
{

/// Options that every verb has.
struct CommonOptions {
    std::optional<int> threads; ///< default: all that the process may use
    std::uint64_t maxBytes = 0; ///< memory the process may take
    std::string progress = "auto";
    std::string report; ///< file, or "-"; empty: none
    bool quiet = false;
    /// @{ Of a sequence.
    std::vector<int> frames;    ///< all of them; empty: there is no sequence
    std::optional<int> only;    ///< the one of them to make
    bool skipExisting = false;  ///< do not make frames whose outputs are there
    int jobs = 1;               ///< frames at the same time
    std::optional<Frame> frame; ///< the one that this run makes
    std::string task;           ///< of a frame's own process, see sequence.h
    /// @}
};

/// The files of a run, which checkFiles() throws where the session only asks for them.
struct NamedFiles {
    std::vector<Output> outputs;
    std::vector<std::string> inputs;
};

/// One run of a verb, from parsed options to exit status.
class Session
{
public:
    /// What a run is for: NameFiles ends it in checkFiles(), which every verb calls before it
    /// works.
    enum class Purpose { Work, NameFiles };
    Session(std::string verb, const CommonOptions& options, Purpose purpose = Purpose::Work);

    Interrupter& progress() { return mProgress; }
    ProgressDisplay& display() { return mDisplay; }
    const CommonOptions& options() const { return mOptions; }
    /// The memory limit less the inputs that were read; 0: there is no limit. @throws LimitError if
    /// nothing is left.
    std::uint64_t bytesLeft() const;
    /// From now on large arrays that memory has no room for lie in files beside @a path, which need
    /// not be there yet.
    void openScratch(const std::filesystem::path& path);
    /// Counts the bytes of an input that stays in memory.
    void hold(std::uint64_t bytes) { mHeld += bytes; }
    /// The report, where verbs add "settings", "input", "field", "grid", "mesh".
    nlohmann::ordered_json& report() { return mReport; }

    /// Whether the output of @a option is one file for all frames of a sequence: this run does not
    /// write it.
    bool isShared(const std::string& option) const;
    /// Checks the verb's outputs and the report by output_check.h, before any work.
    /// @throws NamedFiles, after the checks of usage, where the session only asks for them.
    void checkFiles(const std::vector<Output>& outputs, const std::vector<std::string>& inputs);
    /// Prints information for the user; nothing under --quiet.
    void note(const std::string& message);
    /// Prints @a json on standard output: of a frame as one line, which has its number.
    void printJson(const nlohmann::ordered_json& json) const;
    /// Prints a warning, and adds it to the report.
    void warn(const std::string& message);
    /// Prints the error that ends the run, and adds it to the report.
    void fail(const char* type, const std::string& message);
    /// The times of all stages as text.
    std::string timesText() const;
    /// Adds the stages to the report and writes it, if there is a file for it. @throws IoError.
    void writeReport();
    /// The report as JSON.
    std::string reportText() const;

private:
    const Purpose mPurpose;
    const std::string mVerb;
    const CommonOptions mOptions;
    std::uint64_t mHeld = 0; ///< bytes
    std::string mReportFile; ///< empty until it was checked
    ProgressDisplay mDisplay;
    Interrupter mProgress;
    nlohmann::ordered_json mReport = nlohmann::ordered_json::object();
    std::unique_ptr<tbb::global_control> mThreads;
    std::unique_ptr<ScratchMemory> mScratch;
};

} // namespace mpuvdb::command
