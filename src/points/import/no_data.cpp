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

/// The two outermost of some values in one direction, and how many times the first is there.
struct Outermost {
    double first = std::numeric_limits<double>::infinity(), second = first; ///< lowest are first
    std::size_t count = 0;

    void add(double value, std::size_t times)
    {
        if (value < first) {
            second = first;
            first = value;
            count = 0;
        }
        if (value == first)
            count += times;
        else
            second = std::min(second, value);
    }
    void add(const Outermost& more)
    {
        if (more.count > 0) add(more.first, more.count);
        if (more.second < second && more.second != first) second = more.second;
    }
};

/// The coordinates of an axis.
struct AxisValues {
    std::vector<double> none;  ///< those that may be none, each once
    Outermost lowest, highest; ///< of the others; of the highest the negatives

    void add(double value)
    {
        if (mayBeNone(value)) {
            if (std::find(none.begin(), none.end(), value) == none.end()) none.push_back(value);
        } else if (std::isfinite(value)) {
            lowest.add(value, 1);
            highest.add(-value, 1);
        }
    }
    void add(const AxisValues& more)
    {
        for (const double value : more.none) add(value);
        lowest.add(more.lowest);
        highest.add(more.highest);
    }
    double low() const { return lowest.first; }
    double high() const { return -highest.first; }
};

/// Whether several values are the same, and farther from all others than these, up to @a end, are
/// from each other.
bool standApart(const Outermost& outermost, double end)
{
    const double extent = end - outermost.second;
    return outermost.count > 1 && extent > 0 && outermost.second - outermost.first > extent;
}

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
        const double low = all.low(), high = all.high();
        for (const double value : all.none)
            if (high > low && low - value > high - low) {
                mValues[axis].push_back(value);
                mAny = true;
            }
        const auto doubt = [&](std::size_t count, double value) {
            mDoubts.push_back(fmt::format(
                "{} of its points have {} = {}, farther from all others than these are from each "
                "other: leave them out of the file if that stands for no data",
                count, "xyz"[axis], value));
        };
        if (standApart(all.lowest, high)) doubt(all.lowest.count, low);
        if (standApart(all.highest, -low)) doubt(all.highest.count, high);
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
