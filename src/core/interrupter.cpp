#include <mpuvdb/interrupter.h>

#include "cpu_time.h"
#include "peak_memory.h"
#include <mpuvdb/error.h>

#include <algorithm>

namespace mpuvdb
{

Interrupter& Interrupter::silent()
{
    static Interrupter none{Silent{}};
    return none;
}

void Interrupter::throwInterrupted()
{
    throw Interrupted();
}

void Interrupter::ask() const
{
    /// Least time between two calls of the caller's function, nanoseconds. [derived: a stop may
    /// take 250 ms, most of which is work]
    constexpr std::int64_t kAskInterval = 20'000'000;
    const std::int64_t now = std::chrono::steady_clock::now().time_since_epoch().count();
    if (now < mAskAt.load(std::memory_order_relaxed)) return;
    std::unique_lock<std::mutex> lock(mAsking, std::try_to_lock);
    if (!lock) return;
    mAskAt.store(now + kAskInterval, std::memory_order_relaxed);
    if (mWantsToStop()) mStopped.store(true, std::memory_order_relaxed);
}

void Interrupter::beginStage(const std::string& name, double units)
{
    if (mSilent) return;
    check();
    std::lock_guard<std::mutex> lock(mMutex);
    closeStage();
    mStage = StageTime{name, 0, 0, 0};
    mStageStart = std::chrono::steady_clock::now();
    mStageCpuStart = processCpuSeconds();
    mUnits = std::max(units, 1e-300);
    mDone = mReported = 0;
    mOpen = true;
    if (mListener) mListener(name, 0);
}

void Interrupter::advance(double units)
{
    if (mSilent) return;
    check();
    std::lock_guard<std::mutex> lock(mMutex);
    mDone += units;
    const double fraction = std::min(mDone / mUnits, 1.0);
    // Half a percent per call at most: a listener may draw.
    if (mListener && mOpen && (fraction >= mReported + 0.005 || fraction == 1)) {
        mReported = fraction;
        mListener(mStage.name, fraction);
    }
}

void Interrupter::endStage()
{
    std::lock_guard<std::mutex> lock(mMutex);
    closeStage();
}

void Interrupter::closeStage()
{
    if (!mOpen) return;
    mOpen = false;
    const auto elapsed = std::chrono::steady_clock::now() - mStageStart;
    mStage.seconds = std::chrono::duration<double>(elapsed).count();
    mStage.cpuSeconds = processCpuSeconds() - mStageCpuStart;
    mStage.peakBytes = peakResidentBytes();
    mStages.push_back(mStage);
}

std::vector<StageTime> Interrupter::stages() const
{
    std::lock_guard<std::mutex> lock(mMutex);
    return mStages;
}

void Interrupter::note(std::string text)
{
    if (mSilent) return;
    std::lock_guard<std::mutex> lock(mMutex);
    if (std::find(mNotes.begin(), mNotes.end(), text) == mNotes.end())
        mNotes.push_back(std::move(text));
}

std::vector<std::string> Interrupter::notes() const
{
    std::lock_guard<std::mutex> lock(mMutex);
    return mNotes;
}

} // namespace mpuvdb
