// Positions that were rounded to steps far above the distance between neighbors.
#pragma once
#include "raw_points.h"

#include <string>
#include <vector>

namespace mpuvdb
{

/// Which coordinates of @a points lie in steps so coarse that the surface shows them instead of its
/// shape, and the cure: one text, or none. Told by the positions alone, whatever they came as:
/// floats far from the origin, text with few decimals, LAS of a coarse scale. Points that have a
/// step's distance from each other (voxels, rasters), and slices, whose points lie on curves, are
/// not rounded. Looks closely at 65 thousand of them.
std::vector<std::string> findRounding(const FilePoints& points, Interrupter& progress);

} // namespace mpuvdb
