// Particles to a level set: liquids, splashes, and points that fill a solid.
//
// A particle is a ball with a center and a radius. Its surface is that of the balls themselves, or
// a smooth one by anisotropic kernels [Yu13], in which sheets and threads stay whole.
#pragma once
#include <mpuvdb/length.h>
#include <mpuvdb/level_set.h>
#include <mpuvdb/point_input.h>

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// Balls about a frame: a particle's world position is frame + position. What is optional is empty,
/// or has one value per particle.
struct Particles {
    Vec3d frame = Vec3d::Zero();       ///< world position of the local origin, near the middle
    std::vector<Vec3f> positions;      ///< world units, relative to frame; finite
    std::vector<float> radii;          ///< world units, above 0; or empty
    std::vector<Vec3f> velocities;     ///< world units per second; or empty
    std::vector<Rgb> colors;           ///< sRGB; or empty
    std::vector<NamedScalars> scalars; ///< of different names, to become grids
    std::map<std::string, std::uint64_t> dropped; ///< particles left out, by reason
    std::vector<std::string> notes, warnings;     ///< of their reader, for the user

    std::size_t size() const { return positions.size(); }
};

/// Particles in the caller's memory, which has to outlive the view. What is optional is empty, or
/// has a row for each particle.
struct ParticleView {
    NumberView positions;  ///< 3 numbers, world units
    NumberView radii;      ///< 1 number, world units
    NumberView velocities; ///< 3 numbers, world units per second
    NumberView colors;     ///< 3 numbers in sRGB: bytes, or floats in [0, 1]
    std::vector<std::pair<std::string, NumberView>> scalars; ///< at most 4, 1 number, by name
};

/// Take particles from memory; those whose positions are not finite are left out and counted.
/// @throws UsageError (attributes of another number than the particles, names of scalars that are
/// empty or too many), InputError (nothing to use), Interrupted.
Particles importParticles(const ParticleView& particles, Interrupter* interrupter = nullptr);

/// The scalars by which files name radii and velocities.
struct ParticleNames {
    std::string radius;                ///< of a radius, or of a diameter; empty: there is none
    double radiusScale = 1;            ///< of that number to the radius
    std::vector<std::string> velocity; ///< of its two or three components, or empty

    /// Those among @a scalars, whatever their case: radii are "pscale" or "radius", or half of
    /// "width", "widths" or "diameter"; velocities "vx" "vy" "vz", or "v", "vel" or "velocity" with
    /// "_x", ".x" or "[0]" and so on.
    static ParticleNames among(const std::vector<std::string>& scalars);
};

/// The particles of points that were read with these scalars; the other scalars become attributes.
Particles particlesOf(PointInput&& points, const ParticleNames& names);

/// The surface about particles.
enum class ParticleSurface {
    Smooth, ///< an isosurface of anisotropic kernels: a lone particle is its ball, and where many
            ///< lie together the surface bounds the volume that they share
    Spheres ///< the union of the balls
};

/// What is asked for; everything left empty is derived from the particles.
struct ParticleOptions {
    ParticleSurface surface = ParticleSurface::Smooth;
    /// The radius of all particles, instead of their own. Default without radii: the ball has the
    /// volume that the measured spacing leaves each particle.
    std::optional<Length> radius;
    double radiusScale = 1;          ///< of all radii, above 0
    std::optional<Length> voxelSize; ///< default: half the median radius
    double halfWidth = 3;            ///< voxels, in [1.5, 1000]
    bool velocity = true;            ///< a grid of velocities, where particles have them
    /// Bytes that the work may take; default: no limit. It is estimated before it is taken.
    std::optional<std::uint64_t> maxBytes;
};

/// What was found on the way. Lengths are world units.
struct ParticleReport {
    std::uint64_t particles = 0;
    std::map<std::string, std::uint64_t> dropped; ///< particles left out, by reason
    double smallestRadius = 0, medianRadius = 0, largestRadius = 0;
    std::optional<double> spacing; ///< as measured, where no radii were given
    double voxelSize = 0, halfWidth = 0;
    std::uint64_t lost = 0;   ///< balls that the surface does not reach
    std::uint64_t blocks = 0; ///< of 8 x 8 x 8 voxels that were evaluated
    std::uint64_t bytes = 0;  ///< that the work was estimated to take, the particles included
    std::vector<std::string> notes, warnings;
    std::vector<std::string> findings; ///< what of the particles is not shown, with the cure
};

/// Name of the grid of velocities.
constexpr const char* kVelocityName = "v";

/// A level set and what belongs to it.
struct ParticleResult {
    openvdb::FloatGrid::Ptr grid; ///< the level set; the caller's, nobody else holds it
    /// Velocities (kVelocityName: a Vec3s grid, contravariant and relative, world units per
    /// second), colors and scalars as sampleAttributes() makes them, on the voxels of the band.
    std::vector<openvdb::GridBase::Ptr> beside;
    ParticleReport report;

    /// The grid as what operations take; it shares the tree, which must not change any more.
    LevelSet levelSet() const { return LevelSet(grid); }
};

/// The level set about @a particles, called "surface", with true distances in all its band: sound
/// by check(), but that balls (Spheres) which lie close leave creases all over, at which no
/// gradient is 1: their mean may exceed the default tolerance. Equal particles in one order and
/// equal options give equal bytes, for any number of threads.
/// @throws UsageError (options out of range), InputError (no particles, radii that are not above 0
/// and finite), LimitError (memory, index range), Interrupted.
ParticleResult particlesToLevelSet(Particles&& particles, const ParticleOptions& options = {},
                                   Interrupter* interrupter = nullptr);

} // namespace mpuvdb
