#include "no_data.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace mpuvdb
{
namespace
{

/// The largest value that may say so. [derived: the least of nines that rasters of GDAL and Esri
/// have by default]
constexpr double kLargest = -9999;
/// The least number of 16 bits. [derived: its type]
constexpr double kLeastOf16 = -32768;

/// Whether rasters have @a value for no data.
bool mayBeNone(double value)
{
    if (!(value <= kLargest) || value != std::floor(value)) return false;
    if (value == kLeastOf16) return true;
    double next = 1 - value; // of nines: a power of ten
    while (next > 1) next /= 10;
    return next == 1;
}

/// The coordinates of an axis.
struct AxisValues {
    std::vector<double> none; ///< those that may be none, each once
    double low = std::numeric_limits<double>::infinity(), high = -low; ///< of the others

    void add(double value)
    {
        if (mayBeNone(value)) {
            if (std::find(none.begin(), none.end(), value) == none.end()) none.push_back(value);
        } else if (std::isfinite(value)) {
            low = std::min(low, value);
            high = std::max(high, value);
        }
    }
    void add(const AxisValues& more)
    {
        for (const double value : more.none) add(value);
        low = std::min(low, more.low);
        high = std::max(high, more.high);
    }
};

} // namespace

NoData::NoData(const FilePoints& points)
{
    std::vector<std::array<AxisValues, 3>> ofBlocks(points.blocks.size());
    tbb::parallel_for(std::size_t(0), ofBlocks.size(), [&](std::size_t b) {
        for (const Vec3d& place : points.blocks[b].positions)
            for (int axis = 0; axis < 3; ++axis) ofBlocks[b][std::size_t(axis)].add(place[axis]);
    });
    for (std::size_t axis = 0; axis < 3; ++axis) {
        AxisValues all;
        for (const auto& block : ofBlocks) all.add(block[axis]);
        std::sort(all.none.begin(), all.none.end());
        for (const double value : all.none)
            if (all.high > all.low && all.low - value > all.high - all.low) {
                mValues[axis].push_back(value);
                mAny = true;
            }
    }
}

std::string NoData::text() const
{
    std::vector<std::string> values;
    for (std::size_t axis = 0; axis < 3; ++axis)
        for (const double value : mValues[axis])
            values.push_back(fmt::format("{} = {}", "xyz"[axis], value));
    return fmt::format("no data ({})", fmt::join(values, ", "));
}

} // namespace mpuvdb
