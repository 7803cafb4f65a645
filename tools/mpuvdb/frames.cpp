#include "frames.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>

#include <cstdlib>
#include <regex>

namespace mpuvdb::command
{
namespace
{

constexpr int kMaxFrames = 100000;

const std::regex& token()
{
    static const std::regex pattern(R"((#+)|%(0(\d+))?d|\$F(\d*))");
    return pattern;
}

} // namespace

std::vector<int> parseFrames(const std::string& text)
{
    static const std::regex pattern(R"((\d{1,8})(-(\d{1,8})(x(\d{1,8}))?)?)");
    std::smatch parts;
    if (!std::regex_match(text, parts, pattern))
        throw UsageError(fmt::format("--frames {}: is not a range. Write 7, 1-24 or 1-24x2", text));
    const int first = std::atoi(parts[1].str().c_str());
    const int last = parts[3].matched ? std::atoi(parts[3].str().c_str()) : first;
    const int step = parts[5].matched ? std::atoi(parts[5].str().c_str()) : 1;
    if (last < first || step < 1 || (last - first) / step >= kMaxFrames)
        throw UsageError(fmt::format("--frames {}: must ascend, by steps of at least 1, over at "
                                     "most {} frames",
                                     text, kMaxFrames));
    std::vector<int> frames;
    for (int frame = first; frame <= last; frame += step) frames.push_back(frame);
    return frames;
}

bool hasFrame(const std::string& pattern)
{
    return std::regex_search(pattern, token());
}

std::string frameFile(const std::string& pattern, int frame)
{
    std::smatch at;
    if (!std::regex_search(pattern, at, token())) return pattern;
    const int width = at[1].matched        ? int(at[1].length())
                      : at[3].matched      ? std::atoi(at[3].str().c_str())
                      : at[4].length() > 0 ? std::atoi(at[4].str().c_str())
                                           : 1;
    return fmt::format("{}{:0{}d}{}", at.prefix().str(), frame, std::max(width, 1),
                       at.suffix().str());
}

} // namespace mpuvdb::command
