// What every verb works with: progress, messages, the report, limits.
#pragma once
#include "output_check.h"
#include "progress_display.h"

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
};

/// One run of a verb, from parsed options to exit status.
class Session
{
public:
    Session(std::string verb, const CommonOptions& options);

    Interrupter& progress() { return mProgress; }
    const CommonOptions& options() const { return mOptions; }
    /// What the limit leaves beside the inputs that were read; 0: there is no limit.
    std::uint64_t bytesLeft() const;
    /// An input of so many bytes was read, and stays.
    void hold(std::uint64_t bytes) { mHeld += bytes; }
    /// The report under way: verbs add "settings", "input", "field", "grid", "mesh".
    nlohmann::ordered_json& report() { return mReport; }

    /// Check the verb's outputs and the report as output_check.h says, before any work.
    void checkFiles(const std::vector<Output>& outputs, const std::vector<std::string>& inputs);
    /// Tell the user what he may like to know; silent under --quiet.
    void note(const std::string& message);
    /// Tell the user what he has to know.
    void warn(const std::string& message);
    /// Tell the user why it failed, and put it into the report.
    void fail(const char* type, const std::string& message);
    /// Times of all stages, for people.
    std::string timesText() const;
    /// Add the stages to the report and write it, if one was asked for. @throws IoError.
    void writeReport();

private:
    const std::string mVerb;
    const CommonOptions mOptions;
    std::uint64_t mHeld = 0; ///< bytes
    std::string mReportFile; ///< once it is known to be writable
    ProgressDisplay mDisplay;
    Interrupter mProgress;
    nlohmann::ordered_json mReport = nlohmann::ordered_json::object();
    std::unique_ptr<tbb::global_control> mThreads;
};

} // namespace mpuvdb::command
