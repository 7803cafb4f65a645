// The inputs that people brought, in the folder "cases" beside the real data.
#pragma once
#include <cstdlib>
#include <filesystem>
#include <string>

namespace mpuvdb::test
{

/// The path of a case; empty where there are none: a test that needs it says so and is skipped.
inline std::filesystem::path caseFile(const std::string& name)
{
    const char* const data = std::getenv("MPUVDB_DATA_DIR");
    if (!data) return {};
    const auto file = std::filesystem::path(data) / ".." / "cases" / name;
    std::error_code error;
    return std::filesystem::exists(file, error) ? file : std::filesystem::path();
}

} // namespace mpuvdb::test

/// Define @a file as the path of the case called @a name, or skip the test.
#define MPUVDB_CASE(file, name)                                                                    \
    const std::filesystem::path file = ::mpuvdb::test::caseFile(name);                             \
    if (file.empty()) GTEST_SKIP() << "there is no case " << (name) << " beside MPUVDB_DATA_DIR"
