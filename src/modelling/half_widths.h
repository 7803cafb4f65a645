// When half-widths are equal.
#pragma once

namespace mpuvdb
{

/// The relative difference up to which half-widths are equal. [derived: backgrounds are floats]
constexpr double kSameHalfWidth = 1e-5;

} // namespace mpuvdb
