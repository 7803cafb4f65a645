// Which side of a surface is its outside.
#pragma once
#include <mpuvdb/vec.h>

#include <cstdint>
#include <vector>

namespace mpuvdb
{

class Progress;

/// Oriented points of parts that hang together.
struct OrientedParts {
    const std::vector<Vec3f>& positions;
    const std::vector<Vec3f>& normals;
    const std::vector<std::uint32_t>& parts; ///< of each point
};

/// Which parts look inward, by part up to the last, the largest decided first. One that fills a gap
/// of those decided, or lies on them, looks to where their winding number [Barill18] drops. Another
/// is looked at from six sides, along the axes, and what is seen of it votes; unless it lies within
/// an odd number of others: then it is the wall of a cavity, and looks the other way.
/// @throws Interrupted.
std::vector<char> findInwardParts(const OrientedParts& points, Progress& progress);

} // namespace mpuvdb
