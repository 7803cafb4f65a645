// Damaged heads of grids: who reads them may not crash, hang or take what they ask for.
#include "command_process.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/io.h>

#include <gtest/gtest.h>
#include <openvdb/tools/LevelSetSphere.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <new>
#include <random>
#include <sys/resource.h>

namespace mpuvdb::test
{
namespace
{

/// Where a file of one grid may be damaged.
struct Head {
    std::size_t end; ///< up to the root node's counts
    /// The compressed table for delayed loading, which Blosc takes on trust.
    std::size_t table, tableEnd;
};

Head headOf(const std::string& file)
{
    Head head;
    // Behind the name of the transform are its 15 or 18 doubles.
    head.end = file.rfind("UniformScaleMap") + 15 + 120 + 4 + 4 + 8;
    head.table = file.find("__delayedload") + 13;
    std::uint32_t size = 0;
    std::memcpy(&size, file.data() + head.table, sizeof size);
    head.tableEnd = head.table + sizeof size + size;
    return head;
}

Ended describe(const TemporaryFolder& folder, const std::string& file)
{
#ifdef __SANITIZE_ADDRESS__
    const std::string limits; // it reserves all there is
#else
    const std::string limits = "ulimit -v 2097152; ";
#endif
    return run(folder, {"sh", "-c", limits + "exec timeout 20 " MPUVDB_COMMAND " info " + file});
}

/// While it lives, this process may not take more than the command may.
class MemoryLimit
{
public:
    MemoryLimit()
    {
        getrlimit(RLIMIT_AS, &mBefore);
#ifndef __SANITIZE_ADDRESS__
        rlimit limited = mBefore;
        limited.rlim_cur = std::min<rlim_t>(mBefore.rlim_max, rlim_t(2) << 30);
        setrlimit(RLIMIT_AS, &limited);
#endif
    }
    ~MemoryLimit()
    {
        setrlimit(RLIMIT_AS, &mBefore);
    }
    MemoryLimit(const MemoryLimit&) = delete;
    MemoryLimit& operator=(const MemoryLimit&) = delete;

private:
    rlimit mBefore{};
};

/// Whether the reader that the command has refuses a file.
bool isRefused(const std::filesystem::path& file)
{
    const MemoryLimit limit;
    try {
        readGrids(file);
        return false;
    } catch (const Error&) {
        return true;
    } catch (const std::bad_alloc&) {
        return true;
    }
}

// A process takes far longer to start than a head to read: one in four is read by the command, and
// all by what it reads them with, where a crash ends the test as well.
TEST(DamagedGrid, NeverCrashesTheCommand)
{
    const TemporaryFolder folder;
    Interrupter progress;
    const auto sphere = openvdb::tools::createLevelSetSphere<openvdb::FloatGrid>(
        1, openvdb::Vec3f(0.5f, 0, -3), 0.1f);
    writeLevelSet(folder / "good.vdb", LevelSet(sphere), {{"mpuvdb:note", "something"}}, {},
                  &progress);
    const std::string good = readFile(folder / "good.vdb");
    const Head head = headOf(good);
    ASSERT_LT(head.end, good.size());
    ASSERT_LT(head.tableEnd, head.end);
    ASSERT_EQ(describe(folder, "good.vdb").status, 0);

    const char* given = std::getenv("MPUVDB_SEED");
    const std::uint64_t seed = given ? std::strtoull(given, nullptr, 10) : 1;
    std::mt19937_64 random(seed);
    int refused = 0;
    for (int trial = 0; trial < 200; ++trial) {
        std::string bytes = good;
        std::size_t at = 8 + random() % (head.end - 8);
        if (at > head.table && at < head.tableEnd) at += head.tableEnd - head.table;
        if (at >= head.end) continue;
        const int kind = int(random() % 3);
        if (kind == 0)
            bytes[at] = char(bytes[at] ^ (1 << random() % 8));
        else
            for (std::size_t i = 0; i < 4 && at + i < (at < head.table ? head.table : head.end);
                 ++i)
                bytes[at + i] = kind == 1 ? char(0xff) : char(random());
        writeFile(folder / "damaged.vdb", bytes);
        refused += isRefused(folder / "damaged.vdb");
        if (trial % 4 != 0) continue;
        const Ended ended = describe(folder, "damaged.vdb");
        // 3 is a bad input, 5 one that asks for more memory than is allowed.
        ASSERT_TRUE(ended.status == 0 || ended.status == 3 || ended.status == 5)
            << "seed " << seed << ", trial " << trial << ", byte " << at << ", kind " << kind
            << ", status " << ended.status << '\n'
            << ended.err;
    }
    EXPECT_GT(refused, 20);
}

} // namespace
} // namespace mpuvdb::test
