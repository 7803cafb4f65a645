// Which faces of cells join their two inside corners, where these lie diagonally.
#pragma once
#include "sign_halo.h"

namespace mpuvdb
{

/// Decides by the value in the face's middle that the planes at its corners predict. A wall, or a
/// gap, of parallel planes that holds two diagonal corners holds the middle: it is whole however
/// thin it is. And the sheets of all cells make up a manifold: where one sheet of both cells at a
/// face passes it twice, the mesh would have an edge with four faces [Wenger13 §3.3].
class JoinedFaces
{
public:
    using Access = SignHalo::Access;

    explicit JoinedFaces(const Access& access, float voxelSize)
        : mAccess(access), mPerVoxel(1 / voxelSize)
    {
    }

    /// The faces, by bits as in cellSheets(), of the cell at @a at whose corners are @a inside.
    std::uint8_t of(const openvdb::Coord& at, std::uint8_t inside) const;
    /// The corners of the cell at @a at that are inside, by bits as in cellSheets().
    std::uint8_t cornersAt(const openvdb::Coord& at) const;
    /// Whether the lower face across @a axis of the cell at @a at, an ambiguous one, is joined.
    bool isJoined(const openvdb::Coord& at, int axis) const
    {
        return of(at, cornersAt(at)) >> (2 * axis) & 1;
    }

private:
    std::uint8_t inStep(const openvdb::Coord& at, std::uint8_t inside, int step) const;
    bool changes(const openvdb::Coord& at, int axis) const;
    std::uint8_t byValues(const openvdb::Coord& at, std::uint8_t inside) const;
    float towards(const openvdb::Coord& corner, const openvdb::Coord& step) const;

    const Access& mAccess;
    float mPerVoxel;
};

} // namespace mpuvdb
