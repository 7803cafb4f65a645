// Progress on standard error: a bar for people, lines of JSON for programs.
#pragma once
#include <chrono>
#include <mutex>
#include <string>

namespace mpuvdb::command
{

enum class ProgressStyle { None, Bar, JsonLines };

/// Shows stages; its members may be called from any thread.
class ProgressDisplay
{
public:
    explicit ProgressDisplay(ProgressStyle style) : mStyle(style) {}

    ProgressStyle style() const { return mStyle; }

    void show(const std::string& stage, double fraction);
    /// Prints a line on standard error, above the bar.
    void print(const std::string& line);
    /// Removes the bar.
    void clear();

private:
    void erase();

    const ProgressStyle mStyle;
    std::mutex mMutex;
    std::string mStage;
    std::chrono::steady_clock::time_point mDrawn;
    bool mVisible = false;
};

} // namespace mpuvdb::command
