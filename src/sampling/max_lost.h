// How many of the places that a level set is made from may be missing in it.
#pragma once

namespace mpuvdb
{

/// Largest share of the points beyond the band, where that is wider than their limit, and of the
/// particles that voxels pass by. [derived: three times what normal noise leaves beyond the limit]
constexpr double kMaxLost = 0.01;

} // namespace mpuvdb
