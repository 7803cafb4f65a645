// The sheets of the surface in a cell of eight corners, by the corners' signs and by what is joined
// on faces where these are ambiguous.
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

/// The corners of a cell that are inside, by bits. @param value  the value at (x,y,z), each 0 or 1.
template <typename Value>
std::uint8_t cornersInside(const Value& value)
{
    std::uint8_t inside = 0;
    for (int c = 0; c < 8; ++c)
        if (value(c >> 2 & 1, c >> 1 & 1, c & 1) < 0) inside = std::uint8_t(inside | 1 << c);
    return inside;
}

/// The ends of an edge.
constexpr CellEdge cellEdge(int edge)
{
    /// Bits of the axes x, y, z, x, y in a corner's number. [derived: numbering of corners]
    constexpr std::array<int, 5> kBits = {4, 2, 1, 4, 2};
    const auto axis = std::size_t(edge / 4);
    const int low = (edge & 2 ? kBits[axis + 1] : 0) | (edge & 1 ? kBits[axis + 2] : 0);
    return {std::uint8_t(low), std::uint8_t(low | kBits[axis])};
}

/// The faces of a cell, by bits, whose inside corners are two that lie diagonally.
std::uint8_t ambiguousFaces(std::uint8_t inside);

/// The sheets for corners that are inside where @a inside has a bit. Diagonal inside corners of an
/// ambiguous face are joined where @a joined has the face's bit, else separated.
/// @param joined  some of the ambiguous faces.
inline const CellSheets& cellSheets(std::uint8_t inside, std::uint8_t joined);

/// The segments of the sheets across a face, at most two: from one edge to another.
struct FaceSegments {
    std::size_t count = 0;
    std::array<std::array<int, 2>, 2> edges{}; ///< the inside is on the right, seen from outside
};

/// The segments of @a face; an ambiguous one whose inside corners are @a joined, or not.
FaceSegments faceSegments(std::size_t face, std::uint8_t inside, bool joined);

/// Whether one sheet passes an ambiguous face twice.
bool passesTwice(const CellSheets& sheets, int face);

/// The table of cellSheets(): 256 for each set of joined faces.
extern const std::array<CellSheets, 64 * 256> kCellSheets;

const CellSheets& cellSheets(std::uint8_t inside, std::uint8_t joined)
{
    return kCellSheets[256u * joined + inside];
}

} // namespace mpuvdb
