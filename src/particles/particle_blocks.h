// The blocks of voxels in which particles have their surface.
#pragma once
#include "particle_bins.h"

#include <mpuvdb/field.h>

#include <unordered_map>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// Finds the blocks near the surface of balls, and tells the others apart.
class ParticleBlocks
{
public:
    /// @param octaves  outlive this. @param lattice  relative to the particles' frame.
    /// @param fills  whether particles fill the space between them where they lie close.
    ParticleBlocks(const ParticleOctaves& octaves, const Lattice& lattice, bool fills,
                   Interrupter& progress);

    /// The blocks that may hold some surface, or voxels on which its distances depend; sorted by
    /// (x,y,z). @param maxBytes  for the search; 0: no limit. @throws LimitError, Interrupted.
    std::vector<Vec3i> nearSurface(std::uint64_t maxBytes, Interrupter& progress) const;
    /// Whether a block that is not near the surface is taken to lie inside.
    bool isInside(const Vec3i& block) const;
    /// The box of a block's voxel centers, world units, relative to the frame.
    Box3d boxOf(const Vec3i& block) const;

private:
    struct ByPlace {
        std::size_t operator()(const Vec3i& at) const;
    };
    using Fill = std::unordered_map<Vec3i, float, ByPlace>;
    /// Bins of an octave that are full, as are those around them.
    using Cells = std::unordered_map<Vec3i, char, ByPlace>;

    Cells deepCells(const ParticleBins& bins, Interrupter& progress) const;
    bool isDeep(const Vec3i& block) const;
    bool isInBall(const Vec3i& block) const;
    void addBlocks(const Vec3d& center, double radius, std::vector<Vec3i>& blocks) const;

    const ParticleOctaves& mOctaves;
    Lattice mLattice;
    std::vector<Cells> mDeep; ///< by octave; empty where nothing is filled
};

} // namespace mpuvdb
