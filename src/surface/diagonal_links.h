// Voxels that touch at an edge alone, and that lie on one side of the surface's sheets there.
#pragma once
#include "joined_faces.h"

namespace mpuvdb
{

/// The inside is connected, and so is the outside, as the mesh of the surface shows it: over faces
/// of voxels and over these links. For one thread; the tree has to outlive it.
class DiagonalLinks
{
public:
    DiagonalLinks(const openvdb::FloatTree& tree, double voxelSize)
        : mAccess(tree), mFaces(mAccess, float(voxelSize))
    {
    }
    DiagonalLinks(const DiagonalLinks&) = delete;

    /// Calls join(a, b, inside) for each pair of voxels between which, and up to one voxel above
    /// the block at @a origin, lies a face that two pairs share.
    template <typename Join>
    void forEach(const openvdb::Coord& origin, const Join& join) const
    {
        const SignHalo signs(mAccess, origin);
        for (int axis = 0; axis < 3; ++axis)
            for (int x = 0; x < 8; ++x)
                for (int y = 0; y < 8; ++y)
                    for (std::uint32_t z = signs.ambiguous(axis, x, y); z; z &= z - 1)
                        link(origin.offsetBy(x, y, __builtin_ctz(z)), axis, join);
    }

private:
    template <typename Join>
    void link(const openvdb::Coord& at, int axis, const Join& join) const
    {
        openvdb::Coord u = at, v = at, across = at;
        ++u[(axis + 1) % 3], ++v[(axis + 2) % 3];
        ++across[(axis + 1) % 3], ++across[(axis + 2) % 3];
        const bool inside = mFaces.isJoined(at, axis);
        if ((mAccess.getValue(at) < 0) == inside)
            join(at, across, inside);
        else
            join(u, v, inside);
    }

    SignHalo::Access mAccess;
    JoinedFaces mFaces;
};

} // namespace mpuvdb
