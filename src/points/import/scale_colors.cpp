// The scale of colors that are not bytes.
#include "raw_points.h"

#include "core/release.h"
#include <mpuvdb/interrupter.h>

#include <tbb/parallel_for.h>

#include <algorithm>

namespace mpuvdb
{
namespace
{

/// The factor to bytes for components of which the largest is @a largest. On the next scale all
/// would be black, less than 2 of 255 or 256 of 65535; fractions of a high dynamic range may be
/// above 1, and sums of rounded bytes above 255.
float byteScale(float largest)
{
    if (largest < 2) return 255;
    return largest < 256 ? 1 : 255.0f / 65535;
}

float largestOf(const std::vector<PointBlock>& blocks)
{
    float largest = 0;
    for (const PointBlock& block : blocks)
        for (const Vec3f& color : block.rawColors)
            for (const float component : color) largest = std::max(largest, component);
    return largest;
}

} // namespace

void scaleColors(FilePoints& points, Interrupter& progress)
{
    const float scale = byteScale(largestOf(points.blocks));
    for (PointBlock& block : points.blocks) {
        if (block.rawColors.empty()) continue;
        resizeLarge(block.colors, block.rawColors.size());
        tbb::parallel_for(tbb::blocked_range<std::size_t>(0, block.colors.size(), kPointsPerSlice),
                          [&](const auto& range) {
                              progress.check();
                              for (std::size_t i = range.begin(); i < range.end(); ++i)
                                  for (std::size_t c = 0; c < 3; ++c)
                                      block.colors[i][c] = colorByte(
                                          double(scale * block.rawColors[i][Eigen::Index(c)]));
                          });
        release(block.rawColors);
    }
}

} // namespace mpuvdb
