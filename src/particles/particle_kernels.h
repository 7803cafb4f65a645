// Anisotropic kernels about particles [Yu13].
#pragma once
#include "particle_bins.h"

#include "spatial/unset_vector.h"

#include <array>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// The iso value of the sum of all kernels: that on the plane side of particles that fill a
/// half-space. [derived: mean of the extremes: 0.609, half a spacing beyond the outermost layer of
/// a cubic grid, and ln 2, beside layers that are dense, whatever the kernel]
constexpr double kIsoValue = 0.651;
/// Bound of a kernel's longest axis, supports. [derived: axes of 1/2, 1/2 and
/// 1 of a common length, the most that kMaxVariance allows, of unit volume]
constexpr double kLongestAxis = 1.5874011;

/// A kernel: weight * max(0, 1 - q^2)^3, where q^2 is a quadratic form of the place from its
/// center; and the one that the particle has alone, in which smaller ones do not share.
struct ParticleKernel {
    Vec3f center;              ///< world units, relative to the frame
    Vec3f reach;               ///< half of its box, world units
    std::array<float, 6> form; ///< coefficients of xx, yy, zz, 2 xy, 2 xz, 2 yz; per world unit^2
    float weight;              ///< of the kernel; the particle's volume over the sum at its center
    float loneSupport;         ///< of the kernel that a lone particle has, world units
    float loneWeight;          ///< of that kernel, without smaller ones; 0 where there are none

    /// Whether the lone kernel reaches the iso value.
    bool hasBall() const { return double(loneWeight) > kIsoValue; }
};

/// The kernels of particles, which are made where they are needed.
class ParticleKernels
{
public:
    /// @param octaves  outlive this.
    explicit ParticleKernels(const ParticleOctaves& octaves);

    /// Make the kernels of all particles that reach into one of @a boxes.
    /// @param units  by which the running stage advances, in all. @throws Interrupted.
    void makeWithin(const std::vector<Box3d>& boxes, double units, Interrupter& progress);

    /// Call f(kernel) for kernels among which are all that reach into @a box, one of those above;
    /// in an order that depends on the box alone.
    template <class F>
    void forEachNear(const Box3d& box, F&& f) const
    {
        for (std::size_t o = 0; o < mOctaves.size(); ++o)
            mOctaves[o].forEachRunIn(grown(box, o), [&](const ParticleBins::Run& run) {
                for (std::uint32_t n = run.begin; n < run.end; ++n) f(mKernels[o][n]);
            });
    }

private:
    class Neighbors;
    /// @a box, and as far around as kernels of octave @a o reach.
    Box3d grown(const Box3d& box, std::size_t o) const;
    void makeBin(std::size_t octave, std::size_t bin, Interrupter& progress);

    const ParticleOctaves& mOctaves;
    std::vector<UnsetVector<ParticleKernel>> mKernels; ///< by octave and place
    std::vector<std::vector<char>> mMade;              ///< by octave and bin
};

} // namespace mpuvdb
