// The sheets of the surface in a cell of eight corners, by the corners' signs. Neighboring cells
// agree on their common face, so that the sheets of all cells make up a manifold.
#pragma once
#include <array>
#include <cstdint>

namespace mpuvdb
{

/// Corner c of a cell lies at (c >> 2 & 1, c >> 1 & 1, c & 1).
/// Edge e runs along axis e / 4, from the corner that lies at (e >> 1 & 1, e & 1) on the two axes
/// after that one, in cyclic order.
/// Face f is across axis f / 2, on the low side for even f.

struct CellEdge {
    std::uint8_t low, high; ///< corners
};

/// The sheets of a cell.
struct CellSheets {
    static constexpr std::uint8_t kNone = 0xff; ///< no sheet [derived: the type's largest]
    std::uint8_t count = 0;                     ///< of sheets, at most 4
    std::array<std::uint8_t, 12> sheet{};       ///< of each edge; kNone where there is no crossing
    std::array<std::uint16_t, 4> edges{};       ///< of each sheet, by bits
};

/// The ends of an edge.
constexpr CellEdge cellEdge(int edge)
{
    /// Bits of the axes x, y, z, x, y in a corner's number. [derived: numbering of corners]
    constexpr std::array<int, 5> kBits = {4, 2, 1, 4, 2};
    const auto axis = std::size_t(edge / 4);
    const int low = (edge & 2 ? kBits[axis + 1] : 0) | (edge & 1 ? kBits[axis + 2] : 0);
    return {std::uint8_t(low), std::uint8_t(low | kBits[axis])};
}

/// The sheets for corners that are inside where @a inside has a bit. Diagonal inside corners of a
/// face are separated, but joined on the ambiguous face of a cell that is @a turned.
inline const CellSheets& cellSheets(std::uint8_t inside, bool turned);

/// The ambiguous face that one sheet would pass twice, or -1. Where both cells at a face have it as
/// theirs, the mesh would have an edge with four faces; turning it in both avoids that
/// [Wenger13 §3.3].
int ambiguousFace(std::uint8_t inside);

/// The table of cellSheets(): plain cells first, then turned ones.
extern const std::array<CellSheets, 512> kCellSheets;

const CellSheets& cellSheets(std::uint8_t inside, bool turned)
{
    return kCellSheets[inside + (turned ? 256u : 0u)];
}

} // namespace mpuvdb
