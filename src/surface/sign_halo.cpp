#include "sign_halo.h"

#include "core/lanes.h"

#include <cstring>

namespace mpuvdb
{

std::uint64_t SignHalo::passed(int x) const
{
    std::uint64_t bits = 0;
    for (int y = 0; y < 8; ++y) {
        const std::uint32_t a = row(x, y), b = row(x, y + 1), c = row(x + 1, y),
                            d = row(x + 1, y + 1);
        const std::uint32_t any = a | b | c | d, all = a & b & c & d;
        bits |= std::uint64_t((any | any >> 1) & ~(all & all >> 1) & 0xff) << (8 * y);
    }
    return bits;
}

std::uint32_t SignHalo::ambiguous(int axis, int x, int y) const
{
    const std::uint32_t here = row(x, y), u = axis == 0 ? row(x, y + 1) : row(x + 1, y);
    const std::uint32_t v = axis == 2 ? row(x, y + 1) : here >> 1;
    const std::uint32_t across = axis == 2 ? row(x + 1, y + 1) : u >> 1;
    return ~(here ^ across) & ~(u ^ v) & (here ^ u) & 0xff;
}

void SignHalo::addRows(const Access& access, const openvdb::Coord& origin, int bx, int by, int bz)
{
    using Lanes = float __attribute__((vector_size(32)));
    const openvdb::Coord at = origin.offsetBy(8 * bx, 8 * by, 8 * bz);
    const auto* const leaf = access.probeConstLeaf(at);
    const float* const values = leaf ? leaf->buffer().data() : nullptr;
    const std::uint64_t tile = !leaf && access.getValue(at) < 0 ? 0xff : 0;
    for (int x = 0; x < (bx ? 1 : 8); ++x)
        for (int y = 0; y < (by ? 1 : 8); ++y) {
            std::uint64_t inside = tile;
            if (values) {
                Lanes row;
                std::memcpy(&row, values + 64 * x + 8 * y, sizeof row);
                inside = bitsOf(row < 0);
            }
            const int rowX = 8 * bx + x, rowY = 8 * by + y;
            mRows[std::size_t(rowX)][std::size_t(rowY)] |= std::uint32_t(inside & (bz ? 1 : 0xff))
                                                           << (8 * bz);
        }
}

} // namespace mpuvdb
