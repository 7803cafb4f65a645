// The neighbors of a position, as many as it takes to span a plane.
#pragma once
#include "kd_tree.h"

#include <mpuvdb/vec.h>

#include <cstddef>
#include <cstdint>
#include <vector>

namespace mpuvdb
{

/// Neighbors of one position that may be asked for, at most. Lines a times as far apart as their
/// points need 3 a to 6 a [derived: a disc that reaches just beyond the next ones, and what
/// doubling may add]: so many reach lines 64 times as far apart at least, in 60 us.
constexpr std::size_t kMostSpanning = 400;

/// Whether neighbors span a plane, by the sum of the squares of their offsets from a position.
/// @param noise  in that sum, along one axis.
bool spansPlane(const Eigen::Matrix3f& squares, double noise);

/// Nearest neighbors of positions that a surface passes. Along contours and scan lines the nearest
/// lie on one line, whatever the surface: there more are taken, until neighboring lines are among
/// them. The same rule for all positions; where points lie evenly it takes none more.
class SpanningNeighbors
{
public:
    /// @param fewest  neighbors, less than there are positions, which outlive this.
    /// @param noise   standard deviation of the positions, world units: it spans nothing.
    SpanningNeighbors(const std::vector<Vec3f>& positions, std::size_t fewest, double noise);

    /// Fill @a members with @a i and its nearest, which span a plane; or just with the fewest if
    /// so many as may be asked for still lie on a line. The first fewest + 1 stand for all: every
    /// g-th, where there are g times as many, nearest first. @return whether they span a plane.
    bool about(std::size_t i, std::vector<std::uint32_t>& members) const;

private:
    bool span(std::size_t i, const std::vector<std::uint32_t>& members) const;

    const std::vector<Vec3f>& mPositions;
    const KdTree mTree;
    std::size_t mFewest, mMost;
    double mVariance; ///< of noise
};

} // namespace mpuvdb
