// Progress and interruption of long work: one object, which every long function takes last, as a
// pointer that may be null, and which is an OpenVDB interrupter, too.
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

/// Time and memory of one stage of the work.
struct StageTime {
    std::string name;
    double seconds = 0;          ///< wall clock
    double cpuSeconds = 0;       ///< of the whole process
    std::uint64_t peakBytes = 0; ///< the process's largest resident set so far
};

/// Receives the progress of named stages, can stop the work, and collects notes on the result.
/// All members may be called from any thread; stop() also from a signal handler.
class Interrupter
{
public:
    /// @param stage  name of the running stage; @param fraction  in [0,1], never falling.
    using Listener = std::function<void(const std::string& stage, double fraction)>;

    Interrupter() = default;
    explicit Interrupter(Listener listener) : mListener(std::move(listener)) {}
    /// @param wantsToStop  is called every few milliseconds, from any thread, by one at a time.
    Interrupter(Listener listener, std::function<bool()> wantsToStop)
        : mListener(std::move(listener)), mWantsToStop(std::move(wantsToStop))
    {
    }
    Interrupter(const Interrupter&) = delete;
    Interrupter& operator=(const Interrupter&) = delete;

    /// Ask the work to end: its next check() throws Interrupted.
    void stop() noexcept
    {
        if (!mSilent) mStopped.store(true, std::memory_order_relaxed);
    }
    /// Whether the work has been asked to end.
    bool stopped() const noexcept { return mStopped.load(std::memory_order_relaxed); }
    /// @throws Interrupted if stop() was called. Call it at least every few milliseconds.
    void check() const
    {
        if (mWantsToStop) ask();
        if (stopped()) throwInterrupted();
    }

    /// Open a stage of @a units of work; closes the stage before it.
    void beginStage(const std::string& name, double units = 1);
    /// Report @a units more of the stage's work done, and check().
    void advance(double units = 1);
    /// Close the running stage, if there is one.
    void endStage();
    /// Times of the stages closed so far, in order.
    std::vector<StageTime> stages() const;

    /// Add a note on the result, for people: what is to be known though nothing failed, and the
    /// cure.
    void note(std::string text);
    /// The notes so far, in order, each once.
    std::vector<std::string> notes() const;

    /// The interrupter that null stands for: it reports nothing, keeps nothing and never stops.
    static Interrupter& silent();

    /// @{ OpenVDB's interrupter concept.
    void start(const char* = nullptr) {}
    void end() {}
    bool wasInterrupted(int = -1) const noexcept { return stopped(); }
    /// @}

private:
    struct Silent {
    };
    explicit Interrupter(Silent) : mSilent(true) {}
    void ask() const;
    [[noreturn]] static void throwInterrupted();
    void closeStage();

    Listener mListener;
    std::function<bool()> mWantsToStop;
    bool mSilent = false;
    mutable std::atomic<bool> mStopped{false};
    mutable std::atomic<std::int64_t> mAskAt{0}; ///< nanoseconds of the steady clock
    mutable std::mutex mMutex, mAsking;
    std::vector<StageTime> mStages;
    std::vector<std::string> mNotes;
    StageTime mStage;
    std::chrono::steady_clock::time_point mStageStart;
    double mStageCpuStart = 0;
    double mUnits = 0, mDone = 0, mReported = 0;
    bool mOpen = false;
};

/// The caller's interrupter; silent() for null.
inline Interrupter& orSilent(Interrupter* interrupter)
{
    return interrupter ? *interrupter : Interrupter::silent();
}

/// An OpenVDB interrupter (openvdb::util::NullInterrupter, or what derives from it) as one of ours,
/// which asks it by wasInterrupted(percent of the running stage). @a other has to outlive it.
template <typename OpenVdbInterrupter>
class InterrupterOf : public Interrupter
{
public:
    explicit InterrupterOf(OpenVdbInterrupter& other)
        : Interrupter(
              [this](const std::string&, double fraction) { mPercent = int(100 * fraction); },
              [this] { return mOther.wasInterrupted(mPercent); }),
          mOther(other)
    {
    }

private:
    OpenVdbInterrupter& mOther;
    std::atomic<int> mPercent{0};
};

} // namespace mpuvdb
