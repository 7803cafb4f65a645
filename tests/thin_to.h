// Fewer points of scans that are denser than a test needs.
#pragma once
#include <mpuvdb/point_cloud.h>

#include <cstdint>
#include <vector>

namespace mpuvdb::test
{

/// Keep of more than @a most points each second or third or so on, in the order of the file.
inline void thinTo(PointCloud& cloud, std::size_t most)
{
    const std::size_t step = (cloud.size() + most - 1) / most;
    if (step < 2) return;
    std::vector<std::uint8_t> keep(cloud.size());
    for (std::size_t n = 0; n < keep.size(); n += step) keep[n] = 1;
    cloud.compact(keep);
}

} // namespace mpuvdb::test
