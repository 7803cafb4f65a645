// One coarse answer to inside or outside for the whole model, from its points alone: for where no
// data support the local fits.
//
// A nearly harmonic function, held to the points' signed distance near them. A harmonic function
// has no zero set between data that does not end on them (maximum principle), so nothing is
// invented in free space; what is added to it lets openings close as the data around them bend.
#pragma once
#include "mpu/octree/sorted_points.h"
#include "multigrid.h"

#include <mpuvdb/field.h>

#include <array>

namespace mpuvdb
{

class CoarseSign
{
public:
    /// @param noise  standard deviation of the points, world units.
    CoarseSign(const SortedPoints& points, const Box3d& bounds, const RootCube& root, double noise,
               Interrupter& progress);

    /// The most memory that making one takes, of points with @a bounds that are as dense as @a some
    /// of them.
    static std::uint64_t makingPeakBytes(const SortedPoints& some, const Box3d& bounds,
                                         const RootCube& root);

    /// A farther distance is not told: it means nothing, and would outweigh what it is blended
    /// with.
    double farthest() const { return 4 * mStep; }
    /// Where that holds: beyond, distances are added.
    Box3d bounds() const;
    /// Approximate signed distance (world units) and its direction at @a p (local coordinates);
    /// beyond the grid's box that of the nearest point in it, plus the distance to it: all outside.
    FieldSample evaluate(const Vec3d& p) const;
    /// The same bits of evaluate().value at four places at once: x of all, y of all, z of all.
    void evaluateFour(const std::array<std::array<double, 4>, 3>& places,
                      std::array<double, 4>& values) const;
    /// Distance between nodes, world units: how fine the answer is.
    double step() const { return mStep; }
    std::size_t bytes() const { return mU.capacity() * sizeof(float); }

private:
    template <typename T>
    struct Sample;
    template <typename T>
    Sample<T> sample(const std::array<T, 3>& p) const;

    Vec3d mCorner;
    double mStep = 1;       ///< between nodes, world units
    double mSlopeFloor = 0; ///< of |grad u|, per node step: flat u far away is not a zero crossing
    NodeGrid mGrid;
    std::vector<float> mU;
};

} // namespace mpuvdb
