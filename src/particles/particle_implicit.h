// Functions whose zero set is the surface of particles, sampled on the blocks about it.
#pragma once
#include "particle_bins.h"

#include <mpuvdb/field.h>
#include <mpuvdb/particles.h>

#include <openvdb/openvdb.h>

namespace mpuvdb
{

class Interrupter;

/// A function that is negative inside.
struct ParticleImplicit {
    openvdb::FloatTree::Ptr tree; ///< active about its zero set; of the right sign elsewhere
    std::uint64_t blocks = 0;     ///< that were evaluated
};

/// The function of @a surface on @a lattice, which is relative to the particles' frame.
/// @param maxBytes  that this and the distances made of it may take; 0: no limit.
/// @throws LimitError, Interrupted.
ParticleImplicit sampleParticles(const ParticleOctaves& octaves, const Lattice& lattice,
                                 ParticleSurface surface, std::uint64_t maxBytes,
                                 Interrupter& progress);

/// Memory of the whole work, bytes.
std::uint64_t bytesFor(std::size_t particles, std::size_t blocks);

} // namespace mpuvdb
