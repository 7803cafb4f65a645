#include "progress_display.h"

#include <cstdio>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace mpuvdb::command
{
namespace
{

constexpr std::chrono::milliseconds kRedraw{80};
constexpr int kBarWidth = 30;

} // namespace

void ProgressDisplay::show(const std::string& stage, double fraction)
{
    if (mStyle == ProgressStyle::None) return;
    std::lock_guard<std::mutex> lock(mMutex);
    if (mStyle == ProgressStyle::JsonLines) {
        const nlohmann::ordered_json line{{"stage", stage}, {"fraction", fraction}};
        std::fputs((line.dump() + "\n").c_str(), stderr);
        return;
    }
    const auto now = std::chrono::steady_clock::now();
    if (stage == mStage && fraction < 1 && now - mDrawn < kRedraw) return;
    mStage = stage;
    mDrawn = now;
    mVisible = true;
    const int done = int(fraction * kBarWidth);
    std::fputs(fmt::format("\r\033[K{:<12} [{:#<{}}{:.<{}}] {:3.0f} %", stage, "", done, "",
                           kBarWidth - done, 100 * fraction)
                   .c_str(),
               stderr);
    std::fflush(stderr);
}

void ProgressDisplay::print(const std::string& line)
{
    std::lock_guard<std::mutex> lock(mMutex);
    erase();
    std::fputs((line + "\n").c_str(), stderr);
}

void ProgressDisplay::clear()
{
    std::lock_guard<std::mutex> lock(mMutex);
    erase();
}

void ProgressDisplay::erase()
{
    if (mVisible) std::fputs("\r\033[K", stderr);
    mVisible = false;
}

} // namespace mpuvdb::command
