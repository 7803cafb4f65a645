// Each position once, neighbors near each other.
#pragma once
#include <mpuvdb/vec.h>

#include <cstdint>
#include <vector>

namespace mpuvdb
{

/// The positions of a cloud, one of each, in an order that depends on no other and in which
/// neighbors mostly lie together.
struct DistinctPositions {
    explicit DistinctPositions(const std::vector<Vec3f>& cloud);

    std::vector<Vec3f> positions;
    std::vector<std::uint32_t> placeOf; ///< of each point of the cloud
};

} // namespace mpuvdb
