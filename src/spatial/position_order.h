// An order of positions, for results that depend on no other.
#pragma once
#include <mpuvdb/vec.h>

namespace mpuvdb
{

/// By x, then y, then z.
inline bool positionBefore(const Vec3f& a, const Vec3f& b)
{
    if (a.x() != b.x()) return a.x() < b.x();
    return a.y() != b.y() ? a.y() < b.y() : a.z() < b.z();
}

} // namespace mpuvdb
