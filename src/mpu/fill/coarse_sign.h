// A coarse signed field of the whole model, for where no data support the local fits.
//
// It is a spline under tension through the points' signed distance near them: beyond the rim of
// data it goes on as they bend, and farther away it is harmonic, so that nothing is invented there.
#pragma once
#include "coarse_refiner.h"
#include <mpuvdb/field.h>

#include <array>

namespace mpuvdb
{

class ArrayFile;
class ArrayFileWriter;

/// A value of the coarse field, and what is known of it there.
struct CoarseSample {
    double value = 0;               ///< approximate signed distance, world units
    Vec3d gradient = Vec3d::Zero(); ///< of the value
    double step = 0;                ///< distance between nodes, world units

    /// Largest distance, world units: a larger one is meaningless, and would outweigh the values
    /// that it is blended with.
    double maxDistance() const { return maxDistance(step); }
    static double maxDistance(double step) { return 4 * step; }
};

class CoarseSign
{
public:
    /// @param noise  standard deviation of the points, world units. @param unseen  where the field
    /// is to be as fine as the points are.
    CoarseSign(const SortedPoints& points, const Box3d& bounds, const RootCube& root, double noise,
               const Unseen& unseen, Interrupter& progress);

    /// The field that save() wrote to @a file. @throws InputError.
    explicit CoarseSign(const ArrayFile& file);
    /// @throws IoError.
    void save(ArrayFileWriter& file) const;

    /// Largest memory for making one, bytes, for points with @a bounds that are as dense as @a some
    /// of them. @param unseen  among those. @param share  ratio of all points to them.
    static std::uint64_t makingPeakBytes(const SortedPoints& some, const Box3d& bounds,
                                         const RootCube& root, const Unseen& unseen, double share);

    /// Largest maxDistance of a sample, world units.
    double maxDistance() const { return CoarseSample::maxDistance(rootStep()); }
    /// The box within which maxDistance() holds; outside, the distance from the box is added.
    Box3d bounds() const;
    /// The field at @a p (local coordinates). Outside of the root grid's box it is that of the
    /// nearest point in it plus the distance to it.
    CoarseSample evaluate(const Vec3d& p) const;
    /// evaluate()'s value and step, to the bit, at four places at once: x of all, y of all, z of
    /// all.
    void evaluateFour(const std::array<std::array<double, 4>, 3>& places,
                      std::array<double, 4>& values, std::array<double, 4>& steps) const;
    /// Distance between nodes of the root grid, world units: the largest step.
    double rootStep() const { return mLevels.root().step; }
    /// Distance between nodes at @a p, world units.
    double stepAt(const Vec3d& p) const;
    const CoarseLevels& levels() const { return mLevels; }
    std::size_t bytes() const { return mLevels.bytes(); }

private:
    template <typename T>
    struct Sample;
    struct Stencil;
    template <typename T>
    Sample<T> sample(const std::array<T, 3>& p) const;
    Stencil stencilAt(const double (&t)[3]) const;

    double mSlopeFloor = 0; ///< least |grad u|, per node step: far away u is flat
    CoarseLevels mLevels;
};

} // namespace mpuvdb
