// Coordinates that say that there is none.
#pragma once
#include "raw_points.h"

#include <array>
#include <string>
#include <vector>

namespace mpuvdb
{

/// The values by which rasters say that there are no data (-9999 and other rows of nines, -32768),
/// of each axis those that lie below all other coordinates of a file, farther than these are from
/// each other.
class NoData
{
public:
    explicit NoData(const FilePoints& points);

    bool isAt(const Vec3d& place) const
    {
        return mAny && (has(0, place[0]) || has(1, place[1]) || has(2, place[2]));
    }
    /// "no data (z = -9999)"
    std::string text() const;
    /// Of each axis a warning, if several points have one coordinate that lies so, whatever it is.
    const std::vector<std::string>& doubts() const { return mDoubts; }

private:
    bool has(std::size_t axis, double value) const
    {
        for (const double none : mValues[axis])
            if (value == none) return true;
        return false;
    }

    std::array<std::vector<double>, 3> mValues;
    std::vector<std::string> mDoubts;
    bool mAny = false;
};

} // namespace mpuvdb
