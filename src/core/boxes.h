// Helpers for axis-aligned boxes.
#pragma once
#include <mpuvdb/vec.h>

namespace mpuvdb
{

/// Whether @a box has finite corners.
inline bool isFinite(const Box3d& box)
{
    return box.min().allFinite() && box.max().allFinite();
}

} // namespace mpuvdb
