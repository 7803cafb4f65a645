// What the tests of readers and writers share: files of their own, and small files of every format.
#pragma once
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/io.h>

#include <gtest/gtest.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <string>
#include <unistd.h>

namespace mpuvdb::test
{

/// A folder that goes away with the test.
class IoTest : public ::testing::Test
{
protected:
    IoTest()
    {
        const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
        mFolder = std::filesystem::temp_directory_path() /
                  (std::string("mpuvdb-io-") + info->name() + "-" + std::to_string(::getpid()));
        std::filesystem::create_directories(mFolder);
    }
    ~IoTest() override { std::filesystem::remove_all(mFolder); }

    std::filesystem::path path(const std::string& name) const { return mFolder / name; }
    std::filesystem::path put(const std::string& name, const std::string& bytes) const
    {
        std::ofstream(path(name), std::ios::binary) << bytes;
        return path(name);
    }
    PointInput read(const std::string& name, const std::string& bytes,
                    BadPoints bad = BadPoints::Drop) const
    {
        Interrupter progress;
        return readPoints({put(name, bytes)}, bad, {}, {}, &progress);
    }
    /// The message of the InputError that reading gives.
    std::string error(const std::string& name, const std::string& bytes,
                      BadPoints bad = BadPoints::Drop) const
    {
        try {
            read(name, bytes, bad);
        } catch (const InputError& e) {
            return e.what();
        }
        ADD_FAILURE() << name << " was read";
        return {};
    }

private:
    std::filesystem::path mFolder;
};

/// The bytes of a number, in either byte order.
template <class T>
std::string bytesOf(T value, bool bigEndian = false)
{
    std::string bytes(sizeof value, '\0');
    std::memcpy(bytes.data(), &value, sizeof value);
    return bigEndian ? std::string(bytes.rbegin(), bytes.rend()) : bytes;
}

template <class... T>
std::string concat(const T&... parts)
{
    return (std::string() + ... + parts);
}

/// A small good file of one format.
struct Sample {
    std::string name, bytes;
    std::size_t points; ///< that it gives
};

/// One or more good files of every format.
std::vector<Sample> samples();

} // namespace mpuvdb::test
