// Picking points of batches: what a plain loop picks, by every way of doing it.
#include "field_fixture.h"
#include "spatial/compress.h"

#include <gtest/gtest.h>

#include <vector>

namespace mpuvdb
{
namespace
{

using Arrays = std::array<std::vector<float>, kPointFloats>;
using Compress = decltype(&compress);

/// What @a pick writes, with what it may write past it cut off; and that it writes no farther.
Arrays picked(Compress pick, const Arrays& from, const std::vector<std::uint32_t>& marks,
              std::uint32_t bits)
{
    constexpr float kGuard = -7;
    const std::size_t n = marks.size();
    Arrays to;
    std::array<const float*, kPointFloats> sources{};
    std::array<float*, kPointFloats> targets{};
    for (std::size_t a = 0; a < kPointFloats; ++a) {
        to[a].assign(n + kCompressSlack + 1, kGuard);
        sources[a] = from[a].data();
        targets[a] = to[a].data();
    }
    const std::size_t count = pick(sources, marks.data(), n, bits, targets);
    for (auto& array : to) {
        EXPECT_EQ(array.back(), kGuard);
        array.resize(count);
    }
    return to;
}

TEST(Compress, PicksWhatALoopPicks)
{
    test::Random random(20261124);
    for (std::size_t n = 0; n < 700; n += n < 70 ? 1 : 37) {
        Arrays from;
        std::vector<std::uint32_t> marks;
        for (std::size_t i = 0; i < n; ++i) {
            for (auto& array : from) array.push_back(float(random.uniform(0, 1)));
            marks.push_back(std::uint32_t(random.below(256)));
        }
        for (const std::uint32_t bits : {1u, 8u, 0x81u, 0xffu, 0x100u}) {
            Arrays expected;
            for (std::size_t i = 0; i < n; ++i)
                for (std::size_t a = 0; a < kPointFloats && (marks[i] & bits); ++a)
                    expected[a].push_back(from[a][i]);
            EXPECT_EQ(picked(&compress, from, marks, bits), expected) << n << ' ' << bits;
            EXPECT_EQ(picked(&compressByIndex, from, marks, bits), expected) << n << ' ' << bits;
        }
    }
}

} // namespace
} // namespace mpuvdb
