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

/// How many components are on which scale: below 1, but not 0; from 2 on, up to 255, and above.
struct Scales {
    std::uint64_t fractions = 0, bytes = 0, words = 0;
};

Scales countScales(const std::vector<PointBlock>& blocks)
{
    Scales scales;
    for (const PointBlock& block : blocks)
        for (const Vec3f& color : block.rawColors)
            for (const float component : color) {
                scales.fractions += component > 0 && component < 1;
                scales.bytes += component >= 2 && component < 256;
                scales.words += component >= 256;
            }
    return scales;
}

/// The factor to bytes: that of the most components, as few fractions of a high dynamic range are
/// above 2, and few means of bytes below 1.
float byteScale(const Scales& scales)
{
    const std::uint64_t above = scales.bytes + scales.words;
    if (above == 0 || scales.fractions > above) return 255;
    return scales.words > scales.bytes ? 255.0f / 65535 : 1;
}

} // namespace

void scaleColors(FilePoints& points, Interrupter& progress)
{
    const float scale = byteScale(countScales(points.blocks));
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
