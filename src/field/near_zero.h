// Where the zero set of a field may be, by single values.
#pragma once
#include <mpuvdb/field.h>

#include <cmath>

namespace mpuvdb
{

/// Whether the zero set of @a field may come within @a band (world units) of a cube of edge @a edge
/// about @a center, by the value there.
inline bool mayComeNear(const FieldSample& there, double edge, double band)
{
    /// Largest ratio of a value to the distance from the zero set. [tuned: region_test; values are
    /// approximate distances]
    constexpr double kSteepest = 1.5;
    return std::abs(there.value) <= kSteepest * (std::sqrt(3.0) / 2 * edge + band);
}

} // namespace mpuvdb
