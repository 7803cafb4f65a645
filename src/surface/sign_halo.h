// Signs of a block's voxels and of those one step above it.
#pragma once
#include <array>
#include <cstdint>
#include <openvdb/openvdb.h>

namespace mpuvdb
{

/// In rows along z.
class SignHalo
{
public:
    /// An accessor that is not registered with the tree: cheap to make.
    using Access = openvdb::tree::ValueAccessor<const openvdb::FloatTree, false>;

    SignHalo(const Access& access, const openvdb::Coord& origin)
    {
        for (int x = 0; x <= 1; ++x)
            for (int y = 0; y <= 1; ++y) {
                addRows(access, origin, x, y, 0);
                addRows(access, origin, x, y, 1);
            }
    }

    /// The row's voxels that are inside, bit z; x, y and z in [0,8].
    std::uint32_t row(int x, int y) const { return mRows[std::size_t(x)][std::size_t(y)]; }

    /// The cells of a layer that the surface crosses, bit z + 8 y: their corners differ in sign.
    std::uint64_t passed(int x) const;

    /// The corners of a cell that are inside, as in cellSheets().
    std::uint8_t corners(int x, int y, int z) const
    {
        const auto pair = [&](int dx, int dy) {
            return row(x + dx, y + dy) >> z & 3; // bit 0: z, bit 1: z + 1
        };
        return std::uint8_t(pair(0, 0) | pair(0, 1) << 2 | pair(1, 0) << 4 | pair(1, 1) << 6);
    }

    /// The ambiguous faces across @a axis of a row's cells, on their lower sides: bit z.
    std::uint32_t ambiguous(int axis, int x, int y) const;

private:
    /// Add the signs of the block bx, by, bz blocks above.
    void addRows(const Access& access, const openvdb::Coord& origin, int bx, int by, int bz);

    std::array<std::array<std::uint32_t, 9>, 9> mRows{};
};

} // namespace mpuvdb
