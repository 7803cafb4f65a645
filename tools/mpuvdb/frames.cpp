#include "frames.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <regex>

namespace mpuvdb::command
{
namespace
{

constexpr int kMaxFrames = 100000;
constexpr int kMaxWidth = 100; // digits of a frame's number; file systems end names at 255 bytes

/// What stands for a frame's number, and for nothing else.
const std::regex& plainToken()
{
    static const std::regex plain(R"((##+)|%(0(\d+))?d|\$F(\d*))");
    return plain;
}

/// What stands for a frame's number in @a pattern: a single # only where nothing else does, as it
/// may be part of a name, such as shot#1.
const std::regex& tokenOf(const std::string& pattern)
{
    static const std::regex single(R"((#))");
    return isFramePattern(pattern) ? plainToken() : single;
}

} // namespace

std::vector<int> parseFrames(const std::string& text)
{
    static const std::regex pattern(R"((-?\d{1,8})(-(-?\d{1,8})(x(\d{1,8}))?)?)");
    std::smatch parts;
    if (!std::regex_match(text, parts, pattern))
        throw UsageError(fmt::format(
            "--frames {}: is not a range of numbers of up to 8 digits. Write 7, 1-24 or "
            "1-24x2",
            text));
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

bool isFramePattern(const std::string& text)
{
    return std::regex_search(text, plainToken());
}

bool hasFrame(const std::string& pattern)
{
    return std::regex_search(pattern, tokenOf(pattern));
}

std::string frameFile(const std::string& pattern, int frame)
{
    std::string text;
    std::string::const_iterator rest = pattern.begin();
    for (std::sregex_iterator at(rest, pattern.end(), tokenOf(pattern)), end; at != end; ++at) {
        const std::smatch& place = *at;
        const int width = place[1].matched        ? int(place[1].length())
                          : place[3].matched      ? std::atoi(place[3].str().c_str())
                          : place[4].length() > 0 ? std::atoi(place[4].str().c_str())
                                                  : 1;
        text.append(rest, place[0].first);
        text += fmt::format("{:0{}d}", frame, std::clamp(width, 1, kMaxWidth));
        rest = place[0].second;
    }
    return text.append(rest, pattern.end());
}

} // namespace mpuvdb::command
