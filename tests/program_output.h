// What other programs print, for tests of what they read.
#pragma once
#include <cstdio>
#include <string>

namespace mpuvdb::test
{

/// What a program prints; empty if it is not there or fails.
inline std::string outputOf(const std::string& command)
{
    std::string text;
    FILE* const pipe = ::popen((command + " 2>/dev/null").c_str(), "r");
    if (!pipe) return text;
    for (int c = std::fgetc(pipe); c != EOF; c = std::fgetc(pipe)) text += char(c);
    return ::pclose(pipe) == 0 ? text : std::string();
}

} // namespace mpuvdb::test
