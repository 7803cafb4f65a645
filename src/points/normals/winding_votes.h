// What the winding number says of the orientation of parts, where neighbors cannot know.
#pragma once
#include "orientation.h"
#include "oriented_parts.h"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// Links of points to a node of their part: 1 where a normal looks to the side that closes the
/// part, as it does on most of it, and -1 where it looks to the other.
struct WindingVotes {
    std::vector<OrientationLink> links;
    std::size_t nodes = 0;   ///< one more than the last node; the points are the first ones
    std::size_t against = 0; ///< links that say -1
};

/// The votes of the winding number [Barill18] at the points themselves, between the surface's two
/// sides: it is a half on all of a solid, however its pieces hang together, and one more or one
/// less on a piece that looks the other way than the rest. Sheets that enclose nothing say nothing.
/// @param areas  of the surface about each point, world units squared.
/// @param noise  standard deviation of the positions, world units.
/// @throws Interrupted.
WindingVotes windingVotes(const OrientedParts& points, const std::vector<float>& areas,
                          double noise, Interrupter& progress);

} // namespace mpuvdb
