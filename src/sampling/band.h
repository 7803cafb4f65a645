// The sparse set of sampled blocks that becomes a narrow band: search, signs of what lies between,
// closing, assembly.
#pragma once
#include "grid/block_parts.h"
#include <mpuvdb/field.h>

#include <cstdint>
#include <memory>
#include <openvdb/openvdb.h>
#include <optional>
#include <unordered_map>
#include <vector>

namespace mpuvdb
{

class BlockMosaic;
class Interrupter;

/// A voxel: 512 times its block's number, plus its place in the block.
using VoxelId = std::uint64_t;

/// One number per block position.
std::uint64_t packed(const Vec3i& at);

/// Blocks of a box, corners included.
struct BlockBox {
    Vec3i first, last;

    bool holds(const Vec3i& at) const
    {
        return (at.array() >= first.array()).all() && (at.array() <= last.array()).all();
    }
};

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

    /// @param zone  blocks beyond it are not looked at, and nothing is known of them; null: there
    /// are none.
    Band(const Field& field, const Lattice& lattice, double halfWidth, std::uint64_t maxBytes,
         Interrupter& progress, const std::optional<BlockBox>& zone = {});

    /// Sample @a blocks that are not sampled yet, and on from them wherever the band goes on.
    /// Returns the number of blocks sampled.
    std::size_t search(std::vector<Vec3i> blocks);
    /// In a zone, the band may come in from beyond: find what search() does not reach from data.
    void searchUnsupported();
    /// Give every block between the sampled ones a sign; where their faces disagree, sample on.
    void resolveSigns();
    /// Turn the sign of components of voxels (connected by faces) that are small, shut in, and have
    /// no data, or no depth: bubbles that noise, extrapolation and rounding leave. Returns their
    /// number.
    std::size_t removeIslands();
    /// Fill tunnels and cut bridges that are a few voxels wide, and of which data say nothing: what
    /// fits of few points, and the fill between data, leave in folds. Returns their number.
    std::size_t removeHandles();
    /// Activate both sides of every change of sign.
    void close();
    /// Move everything into a tree. The band is empty afterwards.
    openvdb::FloatTree::Ptr assemble();

    bool hasZeroCrossing() const;

    /// Components of voxels of one sign, connected by faces, over all blocks.
    struct Regions {
        /// A connected part of one block.
        struct Part {
            SignWords voxels;
            bool inside;
        };
        std::vector<std::vector<Part>> parts; ///< of each block
        std::vector<std::uint32_t> first;     ///< number of each block's first part
        std::vector<std::uint32_t> roots;     ///< by the number of a part
        /// By root, its voxels: no end where it reaches blocks that are not sampled.
        std::vector<std::uint64_t> voxels;

        std::uint32_t rootOf(std::size_t block, int voxel) const;
    };

private:
    struct Gap;      // a run of unsampled blocks along z
    struct Contacts; // what the sampled blocks around the gaps say
    std::vector<Gap> findGaps() const;
    Contacts labelGaps(std::vector<Gap>& gaps) const;
    const Block* find(const Vec3i& at) const;
    SignWords signChanges(const Block& block) const;
    /// Voxels. A part of data's surface that is less deep is none: where voxels lie in a plane of
    /// the data, rounding tells on which side.
    static constexpr double kHair = 0.02;
    /// Of the band's half-width: values below are zero but for rounding.
    static constexpr float kRounding = 1e-6f;
    static void goOn(const Block& block, std::vector<Vec3i>& blocks);
    void dropUncrossed(std::size_t known);
    void add(Block block);
    Block sample(BlockSampler& sampler, const Vec3i& at) const;
    Block uniformBlock(const Vec3i& at, bool inside) const;
    void ensureLeaf(Block& block);
    std::size_t countData(const Vec3i& block, const SignWords& voxels) const;
    float deepestOf(const Block& block, const SignWords& voxels) const;
    /// If not, the field holds up all that it has.
    bool isFromData() const;
    void turn(Block& block, const SignWords& voxels);
    Regions labelRegions() const;
    std::size_t turnIslands();
    BlockMosaic mosaic() const;
    bool isHeldUp(const std::vector<VoxelId>& voxels, double deepest, bool wire) const;
    void checkMemory() const;
    void checkReach(const Vec3i& at) const;
    bool isKnown(const Vec3i& at) const { return !mZone || mZone->holds(at); }

    const Field& mField;
    Lattice mLattice;
    float mBackground;
    std::uint64_t mMaxBytes;
    Interrupter& mProgress;
    std::optional<BlockBox> mZone;
    Box3d mReach; ///< that no block's corner leaves, world units
    std::vector<Block> mBlocks;
    std::unordered_map<std::uint64_t, std::uint32_t> mIndex; ///< packed position -> block
    std::vector<std::pair<Vec3i, Vec3i>> mInsideRuns;        ///< first, last block; along z
};

} // namespace mpuvdb
