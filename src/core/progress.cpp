#include <mpuvdb/error.h>
#include <mpuvdb/progress.h>

#include <algorithm>
#include <ctime>
#include <sys/resource.h>

namespace mpuvdb
{
namespace
{

double processCpuSeconds()
{
    timespec t{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

std::uint64_t peakResidentBytes()
{
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    return std::uint64_t(usage.ru_maxrss) * 1024;
}

} // namespace

void Progress::check() const
{
    if (stopped()) throw Interrupted();
}

void Progress::beginStage(const std::string& name, double units)
{
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

void Progress::advance(double units)
{
    check();
    std::lock_guard<std::mutex> lock(mMutex);
    mDone += units;
    const double fraction = std::min(mDone / mUnits, 1.0);
    // A listener may draw: half a percent is as fine as anybody looks.
    if (mListener && mOpen && (fraction >= mReported + 0.005 || fraction == 1)) {
        mReported = fraction;
        mListener(mStage.name, fraction);
    }
}

void Progress::endStage()
{
    std::lock_guard<std::mutex> lock(mMutex);
    closeStage();
}

void Progress::closeStage()
{
    if (!mOpen) return;
    mOpen = false;
    const auto elapsed = std::chrono::steady_clock::now() - mStageStart;
    mStage.seconds = std::chrono::duration<double>(elapsed).count();
    mStage.cpuSeconds = processCpuSeconds() - mStageCpuStart;
    mStage.peakBytes = peakResidentBytes();
    mStages.push_back(mStage);
}

std::vector<StageTime> Progress::stages() const
{
    std::lock_guard<std::mutex> lock(mMutex);
    return mStages;
}

void Progress::note(std::string text)
{
    std::lock_guard<std::mutex> lock(mMutex);
    if (std::find(mNotes.begin(), mNotes.end(), text) == mNotes.end())
        mNotes.push_back(std::move(text));
}

std::vector<std::string> Progress::notes() const
{
    std::lock_guard<std::mutex> lock(mMutex);
    return mNotes;
}

} // namespace mpuvdb
