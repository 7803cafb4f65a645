#include "slice_picture.h"
#include "png_image.h"
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <fmt/format.h>
#include <openvdb/tools/Interpolation.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

using Color = Eigen::Array3d;

/// The color of a place, in [0, 1]. @param distance  voxels. @param pixel  edge of one, voxels.
/// @param halfWidth  voxels.
Color colorAt(double distance, double pixel, double halfWidth)
{
    const Color inside(0.98, 0.72, 0.38), deep(0.90, 0.50, 0.18), outside(0.55, 0.72, 0.90),
        far(0.93, 0.94, 0.95), line(0.05, 0.05, 0.08);
    const double depth = std::min(std::abs(distance) / halfWidth, 1.0);
    const Color& from = distance < 0 ? inside : outside;
    const Color& to = distance < 0 ? deep : far;
    Color color = from + depth * (to - from);
    const bool isStriped = depth < 1 && int(std::floor(std::abs(distance))) % 2 == 1;
    if (isStriped) color *= 0.92;
    // The surface is two pixels wide, its edges are smooth.
    const double cover = std::clamp(1.5 - std::abs(distance) / pixel, 0.0, 1.0);
    return color + cover * (line - color);
}

} // namespace

void writeSlicePicture(const std::filesystem::path& file, const LevelSet& levelSet,
                       const SlicePlane& plane, int pixels, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    if (!(pixels >= 16 && pixels <= 8192))
        throw UsageError(
            fmt::format("slice: the picture has {} pixels; it must be in [16, 8192]", pixels));
    const int first = plane.firstAxis(), second = plane.secondAxis();
    Box3d box = levelSet.bounds();
    if (box.isEmpty()) box = Box3d(Vec3d::Constant(-1), Vec3d::Constant(1));
    const Vec3d size = box.sizes();
    const double pixel = std::max(size[first], size[second]) / pixels;
    const auto count = [&](int axis) { return std::max(1, int(std::lround(size[axis] / pixel))); };
    Image image{count(first), count(second), {}};
    image.rgb.resize(std::size_t(3) * std::size_t(image.width) * std::size_t(image.height));
    const double h = levelSet.voxelSize();
    const auto row = [&](int y) {
        openvdb::tools::GridSampler<openvdb::FloatGrid::ConstAccessor, openvdb::tools::BoxSampler>
            sampler(levelSet.grid().getConstAccessor(), levelSet.grid().transform());
        for (int x = 0; x < image.width; ++x) {
            openvdb::Vec3d at;
            at[plane.axis] = plane.height;
            at[first] = box.min()[first] + (x + 0.5) * pixel;
            at[second] = box.max()[second] - (y + 0.5) * pixel;
            const Color color =
                colorAt(double(sampler.wsSample(at)) / h, pixel / h, levelSet.halfWidth());
            for (int c = 0; c < 3; ++c)
                image.rgb[3 * (std::size_t(y) * std::size_t(image.width) + std::size_t(x)) +
                          std::size_t(c)] = std::uint8_t(std::lround(255 * color[c]));
        }
        progress.advance();
    };
    progress.beginStage("slice", image.height);
    tbb::parallel_for(tbb::blocked_range<int>(0, image.height), [&](const auto& range) {
        for (int y = range.begin(); y < range.end(); ++y) row(y);
    });
    progress.endStage();
    writePng(file, image, progress);
}

} // namespace mpuvdb
