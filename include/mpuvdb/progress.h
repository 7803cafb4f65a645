// Progress and cancellation of long work: one object, which is also an OpenVDB interrupter.
#pragma once
#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <mutex>
#include <string>
#include <vector>

namespace mpuvdb
{

/// What one stage of the work took.
struct StageTime {
    std::string name;
    double seconds = 0;          ///< wall clock
    double cpuSeconds = 0;       ///< of the whole process
    std::uint64_t peakBytes = 0; ///< the process's largest resident set so far
};

/// Reports fractions of named stages to a listener, and carries a request to stop back; and keeps
/// what there is to say of the result.
/// All members may be called from any thread; stop() also from a signal handler.
class Progress
{
public:
    /// @param stage  name of the running stage; @param fraction  in [0,1], never falling.
    using Listener = std::function<void(const std::string& stage, double fraction)>;

    Progress() = default;
    explicit Progress(Listener listener) : mListener(std::move(listener)) {}
    Progress(const Progress&) = delete;
    Progress& operator=(const Progress&) = delete;

    /// Ask the work to end: its next check() throws Interrupted.
    void stop() noexcept { mStopped.store(true, std::memory_order_relaxed); }
    bool stopped() const noexcept { return mStopped.load(std::memory_order_relaxed); }
    /// @throws Interrupted if stop() was called. Call it at least every few milliseconds.
    void check() const;

    /// Open a stage of @a units of work; closes the stage before it.
    void beginStage(const std::string& name, double units = 1);
    /// Report @a units more of the stage's work done, and check().
    void advance(double units = 1);
    /// Close the running stage, if there is one.
    void endStage();
    /// Times of the stages closed so far, in order.
    std::vector<StageTime> stages() const;

    /// What the caller should know of the result, though nothing failed: for people, with the cure.
    void note(std::string text);
    /// The notes so far, in order, each once.
    std::vector<std::string> notes() const;

    /// @{ OpenVDB's interrupter concept.
    void start(const char* = nullptr) {}
    void end() {}
    bool wasInterrupted(int = -1) const noexcept { return stopped(); }
    /// @}

private:
    void closeStage();

    Listener mListener;
    std::atomic<bool> mStopped{false};
    mutable std::mutex mMutex;
    std::vector<StageTime> mStages;
    std::vector<std::string> mNotes;
    StageTime mStage;
    std::chrono::steady_clock::time_point mStageStart;
    double mStageCpuStart = 0;
    double mUnits = 0, mDone = 0, mReported = 0;
    bool mOpen = false;
};

} // namespace mpuvdb
