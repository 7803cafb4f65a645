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
    const std::vector<std::uint32_t>& parts; ///< of each point, below positions.size()
};

/// Which parts look inward, by part. A part is looked at along the axes from all six sides, and
/// what is seen of it votes; a part that lies within an odd number of others, told by the winding
/// numbers of their normals [Barill18], is the wall of a cavity and looks the other way.
/// @throws Interrupted.
std::vector<char> findInwardParts(const OrientedParts& points, Progress& progress);

} // namespace mpuvdb
