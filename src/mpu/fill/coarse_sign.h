// A coarse signed field of the whole model, for where no data support the local fits.
//
// It is a nearly harmonic function with the points' signed distance near them. By the maximum
// principle the zero set of a harmonic function ends on data, so nothing is invented in free space;
// a curvature term lets openings close as the data around them bend.
#pragma once
#include "mpu/octree/sorted_points.h"
#include "multigrid.h"
#include <mpuvdb/field.h>

#include <array>

namespace mpuvdb
{

class ArrayFile;
class ArrayFileWriter;

class CoarseSign
{
public:
    /// @param noise  standard deviation of the points, world units.
    CoarseSign(const SortedPoints& points, const Box3d& bounds, const RootCube& root, double noise,
               Interrupter& progress);

    /// The field that save() wrote to @a file. @throws InputError.
    explicit CoarseSign(const ArrayFile& file);
    /// @throws IoError.
    void save(ArrayFileWriter& file) const;

    /// Largest memory for making one, bytes, for points with @a bounds that are as dense as @a some
    /// of them.
    static std::uint64_t makingPeakBytes(const SortedPoints& some, const Box3d& bounds,
                                         const RootCube& root);

    /// Largest distance of the field, world units: a larger one is meaningless, and would outweigh
    /// the values that it is blended with.
    double maxDistance() const { return 4 * mStep; }
    /// The box within which maxDistance() holds; outside, the distance from the box is added.
    Box3d bounds() const;
    /// Approximate signed distance (world units) and gradient at @a p (local coordinates). Outside
    /// of the grid's box it is that of the nearest point in it plus the distance to it.
    FieldSample evaluate(const Vec3d& p) const;
    /// evaluate().value, to the bit, at four places at once: x of all, y of all, z of all.
    void evaluateFour(const std::array<std::array<double, 4>, 3>& places,
                      std::array<double, 4>& values) const;
    /// Distance between nodes, world units.
    double step() const { return mStep; }
    std::size_t bytes() const { return mU.capacity() * sizeof(float); }

private:
    template <typename T>
    struct Sample;
    template <typename T>
    Sample<T> sample(const std::array<T, 3>& p) const;

    Vec3d mCorner;
    double mStep = 1;       ///< distance between nodes, world units
    double mSlopeFloor = 0; ///< least |grad u|, per node step: far away u is flat
    NodeGrid mGrid;
    std::vector<float> mU;
};

} // namespace mpuvdb
