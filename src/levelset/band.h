// The sparse set of sampled blocks that becomes a narrow band: search, signs of what lies between,
// closing, assembly.
#pragma once
#include "block_parts.h"

#include <mpuvdb/field.h>

#include <openvdb/openvdb.h>

#include <cstdint>
#include <memory>
#include <unordered_map>
#include <vector>

namespace mpuvdb
{

class Progress;

/// One number per block position.
std::uint64_t packed(const Vec3i& at);

/// Sampled blocks of one lattice.
class Band
{
public:
    using Leaf = openvdb::FloatTree::LeafNodeType;

    struct Block {
        Vec3i at;
        std::unique_ptr<Leaf> leaf; ///< null: all voxels inactive and of one sign
        SignWords inside{};
    };

    Band(const Field& field, const Lattice& lattice, double halfWidth, std::uint64_t maxBytes,
         Progress& progress);

    /// Sample @a blocks that are not sampled yet, and on from them wherever the band goes on.
    /// Returns the number of blocks sampled.
    std::size_t search(std::vector<Vec3i> blocks);
    /// Give every block between the sampled ones a sign; where their faces disagree, sample on.
    void resolveSigns();
    /// Turn the sign of components of voxels (connected by faces) that are small, shut in, and have
    /// no data: bubbles that noise and extrapolation leave. Returns their number.
    std::size_t removeIslands();
    /// Activate both sides of every change of sign.
    void close();
    /// Move everything into a tree. The band is empty afterwards.
    openvdb::FloatTree::Ptr assemble();

    bool hasZeroCrossing() const;

private:
    struct Gap;      // a run of unsampled blocks along z
    struct Contacts; // what the sampled blocks around the gaps say
    std::vector<Gap> findGaps() const;
    Contacts labelGaps(std::vector<Gap>& gaps) const;
    const Block* find(const Vec3i& at) const;
    void add(Block block);
    Block sample(BlockSampler& sampler, const Vec3i& at) const;
    Block uniformBlock(const Vec3i& at, bool inside) const;
    void ensureLeaf(Block& block);
    std::size_t countData(const Vec3i& block, const SignWords& voxels) const;
    void turn(Block& block, const SignWords& voxels);
    void checkMemory() const;

    const Field& mField;
    Lattice mLattice;
    float mBackground;
    std::uint64_t mMaxBytes;
    Progress& mProgress;
    std::vector<Block> mBlocks;
    std::unordered_map<std::uint64_t, std::uint32_t> mIndex; ///< packed position -> block
    std::vector<std::pair<Vec3i, Vec3i>> mInsideRuns;        ///< first, last block; along z
};

} // namespace mpuvdb
