#include "cell_sheets.h"

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

/// The six faces.
const std::array<Face, 6> kFaces = [] {
    std::array<Face, 6> faces;
    for (int n = 0; n < 6; ++n) faces[std::size_t(n)] = faceOf(n);
    return faces;
}();

CellSheets makeSheets(std::uint8_t inside, std::uint8_t joined)
{
    Links links;
    for (std::size_t face = 0; face < 6; ++face) {
        const FaceSegments across = faceSegments(face, inside, (joined >> face & 1) != 0);
        for (std::size_t n = 0; n < across.count; ++n)
            links.join(across.edges[n][0], across.edges[n][1]);
    }
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

std::uint8_t findAmbiguous(std::uint8_t inside)
{
    std::uint8_t faces = 0;
    for (std::size_t n = 0; n < 6; ++n) {
        const auto& c = kFaces[n].corners;
        const auto isInside = [&](std::size_t k) { return inside >> c[k] & 1; };
        if (isInside(0) == isInside(2) && isInside(1) == isInside(3) && isInside(0) != isInside(1))
            faces = std::uint8_t(faces | 1 << n);
    }
    return faces;
}

/// ambiguousFaces() of each configuration of corners.
const std::array<std::uint8_t, 256> kAmbiguousFaces = [] {
    std::array<std::uint8_t, 256> faces;
    for (std::size_t n = 0; n < 256; ++n) faces[n] = findAmbiguous(std::uint8_t(n));
    return faces;
}();

} // namespace

const std::array<CellSheets, 64 * 256> kCellSheets = [] {
    std::array<CellSheets, 64 * 256> sheets{};
    for (std::size_t joined = 0; joined < 64; ++joined)
        for (std::size_t inside = 0; inside < 256; ++inside)
            if (!(joined & ~kAmbiguousFaces[inside]))
                sheets[256 * joined + inside] =
                    makeSheets(std::uint8_t(inside), std::uint8_t(joined));
    return sheets;
}();

std::uint8_t ambiguousFaces(std::uint8_t inside)
{
    return kAmbiguousFaces[inside];
}

FaceSegments faceSegments(std::size_t face, std::uint8_t inside, bool joined)
{
    const Face& f = kFaces[face];
    const auto isInside = [&](std::size_t n) { return (inside >> f.corners[n % 4] & 1) != 0; };
    std::array<std::size_t, 4> crossed{};
    std::size_t count = 0;
    for (std::size_t n = 0; n < 4; ++n)
        if (isInside(n) != isInside(n + 1)) crossed[count++] = n;
    FaceSegments found;
    // Edge n lies between corners n and n + 1. Seen from high on the axis these turn to the left,
    // so that those passed on the way from an edge to another lie right of the segment.
    const auto add = [&](std::size_t from, std::size_t to) {
        if (isInside(from + 1) != (face % 2 != 0)) std::swap(from, to);
        found.edges[found.count++] = {f.edges[from % 4], f.edges[to % 4]};
    };
    if (count == 2) add(crossed[0], crossed[1]);
    if (count < 4) return found;
    const std::size_t corner = isInside(0) != joined ? 0 : 1; // cut off
    add(corner + 3, corner + 4);
    add(corner + 1, corner + 2);
    return found;
}

bool passesTwice(const CellSheets& sheets, int face)
{
    // Opposite edges of an ambiguous face are linked by different segments.
    const Face& f = kFaces[std::size_t(face)];
    return sheets.sheet[std::size_t(f.edges[0])] == sheets.sheet[std::size_t(f.edges[2])];
}

} // namespace mpuvdb
