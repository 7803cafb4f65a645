// Points that stand much sparser than those about them: what outliers are where there are many.
#pragma once
#include <mpuvdb/vec.h>

#include <cstdint>
#include <vector>

namespace mpuvdb
{

class Progress;

/// Whether a position lies with its neighbours on a plane. @param reach  the distance of the
/// farthest.
bool liesFlat(const std::vector<Vec3f>& positions, std::size_t point,
              const std::vector<std::uint32_t>& neighbors, double reach);

/// Those of @a positions about which others are several times closer together, and that lie on no
/// plane with their own neighbours, as the points of a sparser surface would: a flag for each.
/// The same for any order of the positions and number of threads, where no two distances are equal.
/// About 5 us of processor time per point. @throws Interrupted.
std::vector<char> findSparserPoints(const std::vector<Vec3f>& positions, Progress& progress);

} // namespace mpuvdb
