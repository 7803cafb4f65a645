// Pictures of distributions.
#pragma once
#include "png_image.h"
#include <mpuvdb/vec.h>

#include <vector>

namespace mpuvdb
{

class Interrupter;

/// The color, linear red, green and blue, of a deviation: blue below 0, white at 0, red above, at
/// most saturated from @a range on. @param range  > 0.
Vec3f deviationColor(double deviation, double range);

/// Writes a histogram of @a values as PNG, 800 x 400 pixels: bars between -@a range and @a range
/// in their deviationColor(), with those beyond in the outermost; a tick for each tenth of the
/// range, long ones with their numbers at 0, at the ends and halfway. Values that are not finite
/// are left out.
/// @param range  > 0. @throws IoError, Interrupted.
void writeHistogram(const std::filesystem::path& file, const std::vector<float>& values,
                    double range, Interrupter* interrupter = nullptr);

} // namespace mpuvdb
