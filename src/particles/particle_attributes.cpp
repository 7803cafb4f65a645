#include "particle_attributes.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace mpuvdb
{

/// The particles about a place, found again for the next one only where that lies among other bins.
class ParticleAttributes::Window
{
public:
    explicit Window(const ParticleBins& bins) : mBins(bins) {}

    const ParticleBins& bins() const { return mBins; }
    const std::vector<ParticleBins::Run>& runsIn(const Box3d& box)
    {
        const Vec3i first = mBins.binAt(box.min()), last = mBins.binAt(box.max());
        if (mIsSet && first == mFirst && last == mLast) return mRuns;
        mIsSet = true;
        mFirst = first;
        mLast = last;
        mRuns.clear();
        mBins.forEachRunIn(box, [&](const ParticleBins::Run& run) { mRuns.push_back(run); });
        return mRuns;
    }

private:
    const ParticleBins& mBins;
    bool mIsSet = false;
    Vec3i mFirst, mLast;
    std::vector<ParticleBins::Run> mRuns;
};

/// Call f(bins, number, distance of its center) for the particles about @a place whose kernels
/// reach it, and others.
template <class F>
void ParticleAttributes::forEachAbout(const Vec3f& place, std::vector<Window>& windows, F&& f)
{
    for (Window& window : windows) {
        const ParticleBins& bins = window.bins();
        const Vec3d at = place.cast<double>(),
                    reach = Vec3d::Constant(kSupport * bins.largestRadius());
        for (const ParticleBins::Run& run : window.runsIn({at - reach, at + reach}))
            for (std::uint32_t n = run.begin; n < run.end; ++n)
                f(bins, n, (bins.center(n) - place).norm());
    }
}

/// The distance to the nearest center: the radius of a drop, on its surface.
float ParticleAttributes::distanceToCenter(const Vec3f& place, std::vector<Window>& windows)
{
    float nearest = std::numeric_limits<float>::infinity();
    forEachAbout(place, windows, [&](const ParticleBins&, std::uint32_t, float distance) {
        nearest = std::min(nearest, distance);
    });
    return nearest;
}

/// The weight of a particle of @a radius at a @a distance from its center. Where smaller ones set
/// the @a scale, it is that of one of their size which lies at its border: a large drop does not
/// reach farther over to a small one than that to it.
float ParticleAttributes::weightOf(float distance, float radius, float scale)
{
    const float size = std::min(radius, scale);
    const float at = std::max(distance - radius + size, 0.0f) / (float(kSupport) * size);
    const float t = 1 - at * at;
    return t > 0 ? t * t * t : 0;
}

ParticleAttributes::ParticleAttributes(const Particles& particles, const ParticleOctaves& octaves,
                                       bool velocities)
    : mParticles(particles), mOctaves(octaves),
      mVelocities(velocities && !particles.velocities.empty())
{
    if (mVelocities) mNames.assign(std::begin(kVelocityComponents), std::end(kVelocityComponents));
    for (const NamedScalars& scalars : particles.scalars) mNames.push_back(scalars.name);
}

void ParticleAttributes::add(std::uint32_t i, double weight, std::vector<double>& sums) const
{
    std::size_t channel = 0;
    const auto addNext = [&](float value) { sums[channel++] += weight * double(value); };
    if (hasColors())
        for (const float c : linearColor(mParticles.colors[i])) addNext(c);
    if (mVelocities)
        for (const float v : mParticles.velocities[i]) addNext(v);
    for (const NamedScalars& scalars : mParticles.scalars) addNext(scalars.values[i]);
}

std::uint32_t ParticleAttributes::nearestTo(const Vec3f& place) const
{
    double least = std::numeric_limits<double>::infinity();
    std::uint32_t nearest = 0;
    for (const ParticleBins& bins : mOctaves) {
        // Beyond its kernels, but not far: a place on the surface, by a voxel or so.
        const Vec3d at = place.cast<double>(), reach = Vec3d::Constant(2 * bins.side());
        bins.forEachRunIn({at - reach, at + reach}, [&](const ParticleBins::Run& run) {
            for (std::uint32_t n = run.begin; n < run.end; ++n) {
                const double distance =
                    double((bins.center(n) - place).norm()) - double(bins.radius()[n]);
                if (!(distance < least)) continue;
                least = distance;
                nearest = bins.order()[n];
            }
        });
    }
    return nearest;
}

void ParticleAttributes::evaluate(const Vec3f& place, std::vector<Window>& windows,
                                  std::vector<double>& sums) const
{
    std::fill(sums.begin(), sums.end(), 0.0);
    double all = 0;
    const float scale = distanceToCenter(place, windows);
    forEachAbout(place, windows, [&](const ParticleBins& bins, std::uint32_t n, float distance) {
        const float weight = weightOf(distance, bins.radius()[n], scale);
        if (!(weight > 0)) return;
        all += double(weight);
        add(bins.order()[n], double(weight), sums);
    });
    if (!(all > 0)) {
        all = 1;
        add(nearestTo(place), 1, sums);
    }
    for (double& sum : sums) sum /= all;
}

void ParticleAttributes::evaluate(const std::vector<SurfacePlace>& places,
                                  std::vector<float>& values) const
{
    std::vector<Window> windows(mOctaves.begin(), mOctaves.end());
    std::vector<double> sums(channels());
    values.clear();
    values.reserve(places.size() * sums.size());
    for (const SurfacePlace& place : places) {
        evaluate((place.position - mParticles.frame).cast<float>(), windows, sums);
        for (const double sum : sums) values.push_back(float(sum));
    }
}

} // namespace mpuvdb
