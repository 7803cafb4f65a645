// Which side of a surface is its outside.
#pragma once
#include "oriented_parts.h"

#include <cstdint>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// Which parts look inward, by part up to the last, the largest decided first. One that fills a gap
/// of those decided, or lies on them, looks to where their winding number [Barill18] drops. One
/// that closes a solid with others, however wide the gaps are, looks so that the numbers on their
/// surfaces come nearest to a half. Another is looked at from six sides, along the axes, and what
/// is seen of it votes; unless it lies within an odd number of others: then it is the wall of a
/// cavity, and looks the other way.
/// @throws Interrupted.
std::vector<char> findInwardParts(const OrientedParts& points, Interrupter& progress);

} // namespace mpuvdb
