#include <gtest/gtest.h>

namespace mpuvdb
{
namespace
{

/// The program runs the kernels of a smaller instruction set (instruction_set.cpp).
TEST(Golden, RunsASmallerInstructionSet)
{
    EXPECT_FALSE(__builtin_cpu_supports(MPUVDB_WITHOUT));
}

} // namespace
} // namespace mpuvdb
