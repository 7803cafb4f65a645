// Files of arrays: what was written is there, and what is damaged is refused.
#include "files/array_file.h"
#include "files/mapped_pages.h"
#include <mpuvdb/error.h>

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <numeric>
#include <random>
#include <sstream>
#include <string>
#include <unistd.h>
#include <vector>

namespace mpuvdb
{
namespace
{

namespace fs = std::filesystem;

class ArrayFileTest : public testing::Test
{
protected:
    ArrayFileTest()
        : mFile(fs::temp_directory_path() / fmt::format("array_file_test_{}.bin", ::getpid()))
    {
    }
    ~ArrayFileTest() override { fs::remove(mFile); }

    void writeSome() const
    {
        std::vector<float> numbers(1000);
        std::iota(numbers.begin(), numbers.end(), 1.0f);
        ArrayFileWriter file(mFile);
        file.add("numbers", numbers);
        file.add("name", std::string("of it"));
        file.add("none", std::vector<double>{});
        file.addValue("pair", std::array<int, 2>{3, 4});
        file.finish();
    }
    std::string bytes() const
    {
        std::ifstream in(mFile, std::ios::binary);
        std::ostringstream text;
        text << in.rdbuf();
        return text.str();
    }
    void setBytes(const std::string& bytes) const
    {
        std::ofstream(mFile, std::ios::binary | std::ios::trunc) << bytes;
    }
    /// Read all arrays to their ends.
    double sumOfAll() const
    {
        const ArrayFile file(mFile);
        double sum = 0;
        for (const float number : file.get<float>("numbers")) sum += double(number);
        for (const char c : file.get<char>("name")) sum += c;
        for (const double number : file.get<double>("none")) sum += number;
        const auto pair = file.value<std::array<int, 2>>("pair");
        return sum + pair[0] + pair[1];
    }

    fs::path mFile;
};

TEST_F(ArrayFileTest, HasWhatWasWritten)
{
    writeSome();
    const ArrayFile file(mFile);
    const auto numbers = file.get<float>("numbers");
    ASSERT_EQ(numbers.size(), 1000u);
    EXPECT_EQ(numbers[0], 1.0f);
    EXPECT_EQ(numbers[999], 1000.0f);
    EXPECT_EQ(numbers.bytes(), 0u); // mapped
    const auto name = file.get<char>("name");
    EXPECT_EQ(std::string(name.begin(), name.end()), "of it");
    EXPECT_TRUE(file.get<double>("none").empty());
    const auto pair = file.value<std::array<int, 2>>("pair");
    EXPECT_EQ(pair[1], 4);
    EXPECT_TRUE(file.has("pair"));
    EXPECT_FALSE(file.has("pairs"));
    EXPECT_THROW(file.get<float>("pairs"), InputError);
    EXPECT_THROW(file.get<double>("numbers"), InputError);
    EXPECT_THROW(file.value<float>("numbers"), InputError);
}

TEST_F(ArrayFileTest, AnArrayMayBeWrittenInPieces)
{
    {
        ArrayFileWriter file(mFile);
        const std::size_t first = file.reserve<int>("first", 4), second = file.reserve<int>("b", 2);
        const std::array<int, 4> numbers = {1, 2, 3, 4};
        file.write(second, 0, numbers.data(), 2);
        file.write(first, 2, numbers.data() + 2, 2);
        file.write(first, 0, numbers.data(), 2);
        EXPECT_THROW(file.write(second, 1, numbers.data(), 2), std::logic_error);
        file.finish();
    }
    const auto array = ArrayFile(mFile).get<int>("first"); // outlives the file's object
    EXPECT_EQ(std::vector<int>(array.begin(), array.end()), (std::vector<int>{1, 2, 3, 4}));
}

TEST_F(ArrayFileTest, ShorterFilesAreRefused)
{
    writeSome();
    const std::string whole = bytes();
    for (std::size_t size = 0; size < whole.size(); size += size < 100 ? 1 : 37) {
        setBytes(whole.substr(0, size));
        EXPECT_THROW(ArrayFile{mFile}, InputError) << size;
    }
    setBytes(whole + "x");
    EXPECT_THROW(ArrayFile{mFile}, InputError);
    fs::remove(mFile);
    EXPECT_THROW(ArrayFile{mFile}, IoError);
}

TEST_F(ArrayFileTest, DamagedHeadsAndDirectoriesLeadNowhereElse)
{
    writeSome();
    const std::string whole = bytes();
    const double sum = sumOfAll();
    constexpr unsigned kSeed = 7;
    std::mt19937 random(kSeed);
    const std::size_t directory = whole.size() - 4 * 56;
    for (int n = 0; n < 500; ++n) {
        std::string damaged = whole;
        const std::size_t at = n % 2 ? random() % 32 : directory + random() % (4 * 56);
        damaged[at] = char(random());
        setBytes(damaged);
        try { // within the file, or refused
            EXPECT_TRUE(std::isfinite(sumOfAll()) || sum > 0) << "seed " << kSeed;
        } catch (const InputError&) {
        }
    }
}

TEST_F(ArrayFileTest, ForgottenPagesComeBack)
{
    std::vector<std::uint64_t> numbers(std::size_t(1) << 20);
    std::iota(numbers.begin(), numbers.end(), 1u);
    ArrayFileWriter writer(mFile);
    writer.add("numbers", numbers);
    writer.finish();
    const auto residentBytes = [] {
        std::ifstream status("/proc/self/statm");
        std::uint64_t size = 0, resident = 0;
        status >> size >> resident;
        return double(resident) * double(::sysconf(_SC_PAGESIZE));
    };
    const double bytes = double(numbers.size() * sizeof numbers[0]);
    const StoredArray<std::uint64_t> mapped = ArrayFile(mFile).get<std::uint64_t>("numbers");
    const double before = residentBytes();
    EXPECT_TRUE(std::equal(mapped.begin(), mapped.end(), numbers.begin()));
    const double read = residentBytes();
    EXPECT_GT(read - before, 0.5 * bytes);
    forgetMappedPages();
    EXPECT_LT(residentBytes() - before, 0.5 * bytes);
    EXPECT_TRUE(std::equal(mapped.begin(), mapped.end(), numbers.begin()));
}

TEST_F(ArrayFileTest, AFullDiskIsSaid)
{
    EXPECT_THROW(ArrayFileWriter(fs::path("/nowhere/at/all")), IoError);
    if (!fs::exists("/dev/full")) GTEST_SKIP() << "there is no /dev/full";
    ArrayFileWriter file("/dev/full");
    try {
        file.add("numbers", std::vector<double>(100000));
        FAIL() << "nothing was said";
    } catch (const IoError& e) {
        EXPECT_TRUE(e.mayPass());
    }
}

} // namespace
} // namespace mpuvdb
