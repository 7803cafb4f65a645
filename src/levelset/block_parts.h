// Connected parts of a block's voxels.
#pragma once
#include <mpuvdb/field.h>

#include <array>
#include <cstdint>
#include <vector>

namespace mpuvdb
{

/// Signs (1: inside) of a block's voxels: word x, bit 8 y + z, as in an OpenVDB leaf's mask.
using SignWords = std::array<std::uint64_t, kBlockDim>;

/// The parts of @a voxels that are connected by faces, by their first voxels.
std::vector<SignWords> connectedParts(const SignWords& voxels);

/// Whether two parts meet across the face from block a to its upper neighbour b on @a axis.
bool meet(const SignWords& a, const SignWords& b, int axis);

/// Whether there are voxels at the upper or lower face across @a axis.
bool reachesFace(const SignWords& a, int axis, bool upper);

std::uint64_t countVoxels(const SignWords& words);

} // namespace mpuvdb
