// Detects positions rounded to steps far above the distance between neighbors.
#pragma once
#include "raw_points.h"

#include <optional>
#include <string>

namespace mpuvdb
{

/// A warning about coordinates of @a points in steps so coarse that the surface shows them, with
/// the cure. It depends on the positions alone: floats far from the origin, text with few decimals,
/// and LAS of a coarse scale are alike. Points a step apart from each other
/// (voxels, rasters), and slices, whose points lie on curves, are not rounded. About 65 thousand
/// points are examined.
std::optional<std::string> findRounding(const FilePoints& points, Interrupter& progress);

} // namespace mpuvdb
