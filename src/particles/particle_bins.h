// Particles in cubic bins, by octaves of their radius.
#pragma once
#include <mpuvdb/vec.h>

#include <cmath>
#include <cstdint>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// Largest support of a kernel before it is flattened, radii of its particle: that among many
/// others. [derived: as many particles as shape a kernel, 25, lie in the half of it beside a plane
/// surface, each with its ball's volume: cbrt(50)]
constexpr double kSupport = 3.684031;

/// Particles whose radii are within a factor of two, sorted by bins.
class ParticleBins
{
public:
    /// Places of particles that lie one after the other.
    struct Run {
        std::uint32_t begin, end;
    };
    struct Bin {
        Vec3i at;
        Run run;
    };

    /// @param of  indices of the particles that are binned, in the caller's arrays.
    /// @param bounds  box of all @a positions. @param unit  radius of a particle of unit volume.
    ParticleBins(const std::vector<Vec3f>& positions, const std::vector<float>& radii,
                 const std::vector<std::uint32_t>& of, const Box3d& bounds, double unit,
                 Interrupter& progress);

    std::size_t size() const { return mOrder.size(); }
    /// The largest radius, world units.
    double largestRadius() const { return mLargest; }
    /// The side of a bin, world units: kSupport largest radii, or more where the bins
    /// would be too many.
    double side() const { return mSide; }
    const std::vector<Bin>& bins() const { return mBins; }
    /// The caller's index of the particle at each place.
    const std::vector<std::uint32_t>& order() const { return mOrder; }
    /// @{ Coordinates and radii by place, world units, and volumes. Eight more numbers behind the
    /// last place may be read.
    const float* x() const { return mX.data(); }
    const float* y() const { return mY.data(); }
    const float* z() const { return mZ.data(); }
    const float* radius() const { return mRadius.data(); }
    const float* volume() const { return mVolume.data(); }
    /// @}
    Vec3f center(std::size_t place) const { return {mX[place], mY[place], mZ[place]}; }
    Vec3d lowerCorner(const Vec3i& bin) const { return mCorner + mSide * bin.cast<double>(); }
    /// The bin of a place, or the one at the border that is nearest to it.
    Vec3i binAt(const Vec3d& position) const
    {
        const Eigen::Array3d at = ((position - mCorner) / mSide).array().floor();
        return at.max(0.0).min(mLast.array()).cast<int>();
    }

    /// Call f(first, end) for ranges of numbers of bins that together are all those in @a box, and
    /// others near it; in an order that depends on the box alone.
    template <class F>
    void forEachColumnIn(const Box3d& box, F&& f) const
    {
        const Vec3i first = binAt(box.min()), last = binAt(box.max());
        std::size_t begin = notBefore(0, first);
        while (begin < mBins.size() && mBins[begin].at[0] <= last[0]) {
            const Vec3i at = mBins[begin].at;
            if (at[1] < first[1]) {
                begin = notBefore(begin, {at[0], first[1], first[2]});
            } else if (at[1] > last[1]) {
                begin = notBefore(begin, {at[0] + 1, first[1], first[2]});
            } else if (at[2] < first[2]) {
                begin = notBefore(begin, {at[0], at[1], first[2]});
            } else {
                std::size_t end = begin;
                while (end < mBins.size() && mBins[end].at.head<2>() == at.head<2>() &&
                       mBins[end].at[2] <= last[2])
                    ++end;
                if (begin < end) f(begin, end);
                begin = notBefore(end, {at[0], at[1] + 1, first[2]});
            }
        }
    }
    /// The same with the run of the particles in each range.
    template <class F>
    void forEachRunIn(const Box3d& box, F&& f) const
    {
        forEachColumnIn(box, [&](std::size_t begin, std::size_t end) {
            f(Run{mBins[begin].run.begin, mBins[end - 1].run.end});
        });
    }

private:
    /// The number of the first bin, of those from @a begin on, that is not before the place @a at.
    std::size_t notBefore(std::size_t begin, const Vec3i& at) const;

    Vec3d mCorner;
    double mSide = 0, mLargest = 0;
    Vec3d mLast = Vec3d::Zero(); ///< the last bin along each axis
    std::vector<std::uint32_t> mOrder;
    std::vector<float> mX, mY, mZ, mRadius, mVolume;
    std::vector<Bin> mBins;           ///< by their keys
    std::vector<std::uint64_t> mKeys; ///< of the bins
};

/// The bins of all octaves, the smallest radii first.
using ParticleOctaves = std::vector<ParticleBins>;

/// @param radii  above 0 and finite. @throws Interrupted.
ParticleOctaves binParticles(const std::vector<Vec3f>& positions, const std::vector<float>& radii,
                             Interrupter& progress);

} // namespace mpuvdb
