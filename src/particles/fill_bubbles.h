// Gaps among particles that are no bubbles.
#pragma once
#include <cstdint>
#include <openvdb/openvdb.h>

namespace mpuvdb
{

class Interrupter;

/// Turn what is enclosed, by faces of voxels, outside, and no more than @a most voxels to the
/// inside: gaps between particles that lie a little farther apart than others are no bubbles.
/// @param tree  leaves of any function that is negative inside; tiles have the right signs.
/// @return the number of bubbles. @throws Interrupted.
std::uint64_t fillBubbles(openvdb::FloatTree& tree, std::uint64_t most, Interrupter& progress);

} // namespace mpuvdb
