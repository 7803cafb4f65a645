#include "cell_sheets.h"

#include <vector>

namespace mpuvdb
{
namespace
{

/// The bit of an axis in a corner's number.
constexpr int bitOf(int axis)
{
    return 4 >> axis;
}

int edgeOf(int corner, int axis)
{
    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
    return 4 * axis + 2 * ((corner & bitOf(u)) != 0) + ((corner & bitOf(v)) != 0);
}

/// The corners of a face in cyclic order, and the edge from each to the next.
struct Face {
    std::array<int, 4> corners, edges;
};

Face faceOf(int face)
{
    const int axis = face / 2, u = (axis + 1) % 3, v = (axis + 2) % 3;
    const int base = face % 2 ? bitOf(axis) : 0;
    Face result;
    result.corners = {base, base | bitOf(u), base | bitOf(u) | bitOf(v), base | bitOf(v)};
    result.edges = {edgeOf(base, u), edgeOf(base | bitOf(u), v), edgeOf(base | bitOf(v), u),
                    edgeOf(base, v)};
    return result;
}

/// Disjoint sets of edges; those linked by a segment across a face are one set.
class Links
{
public:
    Links()
    {
        for (std::uint8_t e = 0; e < 12; ++e) mRoot[e] = e;
    }
    void join(int a, int b) { mRoot[find(a)] = std::uint8_t(find(b)); }
    std::size_t find(int e) const
    {
        std::size_t r = std::size_t(e);
        while (mRoot[r] != r) r = mRoot[r];
        return r;
    }

private:
    std::array<std::uint8_t, 12> mRoot{};
};

/// The pairs of a face's edges that a segment links, at most two.
std::vector<std::array<int, 2>> segments(int face, std::uint8_t inside, bool turned)
{
    const Face f = faceOf(face);
    const auto isInside = [&](std::size_t n) { return (inside >> f.corners[n % 4] & 1) != 0; };
    std::vector<int> crossed;
    for (std::size_t n = 0; n < 4; ++n)
        if (isInside(n) != isInside(n + 1)) crossed.push_back(f.edges[n]);
    if (crossed.empty()) return {};
    if (crossed.size() == 2) return {{crossed[0], crossed[1]}};
    // Edge n lies between corners n and n + 1: corner n is cut off by edges n - 1 and n.
    const std::size_t first = isInside(0) != turned ? 0 : 1;
    return {{f.edges[(first + 3) % 4], f.edges[first]},
            {f.edges[first + 1], f.edges[(first + 2) % 4]}};
}

CellSheets makeSheets(std::uint8_t inside, int turnedFace)
{
    Links links;
    for (int face = 0; face < 6; ++face)
        for (const auto& [a, b] : segments(face, inside, face == turnedFace)) links.join(a, b);
    CellSheets sheets;
    std::array<std::uint8_t, 12> ofRoot;
    ofRoot.fill(CellSheets::kNone);
    for (int e = 0; e < 12; ++e) {
        const CellEdge ends = cellEdge(e);
        sheets.sheet[std::size_t(e)] = CellSheets::kNone;
        if ((inside >> ends.low & 1) == (inside >> ends.high & 1)) continue;
        std::uint8_t& sheet = ofRoot[links.find(e)];
        if (sheet == CellSheets::kNone) sheet = sheets.count++;
        sheets.sheet[std::size_t(e)] = sheet;
        sheets.edges[sheet] = std::uint16_t(sheets.edges[sheet] | 1 << e);
    }
    return sheets;
}

int findAmbiguousFace(std::uint8_t inside)
{
    const CellSheets sheets = makeSheets(inside, -1);
    for (int face = 0; face < 6; ++face) {
        const auto across = segments(face, inside, false);
        if (across.size() == 2 &&
            sheets.sheet[std::size_t(across[0][0])] == sheets.sheet[std::size_t(across[1][0])])
            return face;
    }
    return -1;
}

/// ambiguousFace() for each configuration of corners.
const std::array<int, 256> kAmbiguousFaces = [] {
    std::array<int, 256> faces;
    for (std::size_t n = 0; n < 256; ++n) faces[n] = findAmbiguousFace(std::uint8_t(n));
    return faces;
}();

} // namespace

const std::array<CellSheets, 512> kCellSheets = [] {
    std::array<CellSheets, 512> sheets;
    for (std::size_t n = 0; n < 256; ++n) {
        sheets[n] = makeSheets(std::uint8_t(n), -1);
        sheets[256 + n] = makeSheets(std::uint8_t(n), kAmbiguousFaces[n]);
    }
    return sheets;
}();

int ambiguousFace(std::uint8_t inside)
{
    return kAmbiguousFaces[inside];
}

} // namespace mpuvdb
