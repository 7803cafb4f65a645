// What particles carry, at places on their surface.
#pragma once
#include "particle_bins.h"

#include <mpuvdb/particles.h>
#include <mpuvdb/surface_attributes.h>

namespace mpuvdb
{

/// Means over the particles about a place, weighted by isotropic kernels, which are no longer than
/// those of the size that particles have there.
class ParticleAttributes final : public SurfaceAttributes
{
public:
    /// Names of the components of velocities, which stand before the other scalars.
    static constexpr const char* kVelocityComponents[3] = {"v.x", "v.y", "v.z"};

    /// @param velocities  whether they are among the scalars. All arguments outlive this.
    ParticleAttributes(const Particles& particles, const ParticleOctaves& octaves, bool velocities);

    bool hasColors() const override { return !mParticles.colors.empty(); }
    const std::vector<std::string>& scalarNames() const override { return mNames; }
    void evaluate(const std::vector<SurfacePlace>& places,
                  std::vector<float>& values) const override;

private:
    class Window;
    template <class F>
    static void forEachAbout(const Vec3f& place, std::vector<Window>& windows, F&& f);
    static float distanceToCenter(const Vec3f& place, std::vector<Window>& windows);
    static float weightOf(float distance, float radius, float scale);
    void evaluate(const Vec3f& place, std::vector<Window>& windows,
                  std::vector<double>& sums) const;
    /// Add @a weight times the channels of particle @a i to @a sums.
    void add(std::uint32_t i, double weight, std::vector<double>& sums) const;
    std::uint32_t nearestTo(const Vec3f& place) const;

    const Particles& mParticles;
    const ParticleOctaves& mOctaves;
    bool mVelocities;
    std::vector<std::string> mNames;
};

} // namespace mpuvdb
