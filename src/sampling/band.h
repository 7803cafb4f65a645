// The sparse set of sampled blocks that becomes a narrow band: search, signs of the space between,
// removal of islands and handles, closing, assembly.
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

/// Half-widths, voxels, up to which distances are sampled from fields that are distances everywhere
/// [tuned: csg_bench], and from those that are so near their zero set only [derived: the default
/// half-width]. What lies farther off is measured from the zero set.
constexpr double kMaxFarBand = 20, kMaxNearBand = 3;

class BlockMosaic;
class Interrupter;

/// A voxel: 512 times its block's number, plus its offset in the block.
using VoxelId = std::uint64_t;

/// A block position as one number.
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

    /// A part of space: blocks beyond @a known are not sampled, and their signs are unknown; those
    /// that count are @a wanted.
    struct Zone {
        BlockBox known, wanted;
    };

    /// @param zone  null: all blocks count.
    Band(const Field& field, const Lattice& lattice, double halfWidth, std::uint64_t maxBytes,
         Interrupter& progress, const std::optional<Zone>& zone = {});

    /// Sample those of @a blocks that are not sampled yet, and follow the band from them. Returns
    /// the number of blocks sampled.
    std::size_t search(std::vector<Vec3i> blocks);
    /// In a zone, find the parts of the band that enter it without data, which search() misses.
    void searchUnsupported();
    /// Give every block between the sampled ones a sign; where their faces disagree, sample more.
    void resolveSigns();
    /// Turn the sign of face-connected components of voxels that are small, enclosed, and without
    /// data or depth: bubbles from noise, extrapolation and rounding. Returns their number.
    std::size_t removeIslands();
    /// Fill tunnels and cut bridges that are a few voxels wide and without data: artifacts of fits
    /// to few points, and of the fill in folds. Returns their number.
    std::size_t removeHandles();
    /// Activate both sides of every change of sign.
    void close();
    /// Move everything into a tree. The band is empty afterwards.
    openvdb::FloatTree::Ptr assemble();

    bool hasZeroCrossing() const;
    /// Whether the wanted blocks are those of the whole for certain: no sign of theirs that was in
    /// question depends on what is unknown.
    bool isCertain() const { return mIsCertain; }

    /// Face-connected components of voxels of one sign, over all blocks.
    struct Regions {
        /// A connected part of one block.
        struct Part {
            SignWords voxels;
            bool inside;
        };
        std::vector<std::vector<Part>> parts; ///< of each block
        std::vector<std::uint32_t> first;     ///< number of each block's first part
        std::vector<std::uint32_t> roots;     ///< by the number of a part
        /// Number of voxels by root; huge where a component reaches blocks that are not sampled.
        std::vector<std::uint64_t> voxels;
        std::vector<std::uint8_t> goesOn; ///< by root: whether it reaches beyond the known blocks

        std::uint32_t rootOf(std::size_t block, int voxel) const;
    };

private:
    struct Gap;      // a run of unsampled blocks along z
    struct Contacts; // signs of the sampled blocks around the gaps
    std::vector<Gap> findGaps() const;
    Contacts labelGaps(std::vector<Gap>& gaps) const;
    const Block* find(const Vec3i& at) const;
    SignWords signChanges(const Block& block) const;
    /// Smallest depth of a part of data's surface, voxels: where voxels lie in a plane of the data,
    /// their sign is that of a rounding. [tuned: handles_test]
    static constexpr double kMinFeatureDepth = 0.02;
    /// Magnitude, relative to the half-width, below which values are zero. [derived: eight
    /// roundings of a float]
    static constexpr float kRounding = 1e-6f;
    static void addNeighbors(const Block& block, std::vector<Vec3i>& blocks);
    bool leadsToData(std::size_t from, std::size_t known, std::vector<std::size_t>& followed) const;
    void findUnsupported(const Vec3i& first, int count, BlockSampler& sampler,
                         std::vector<Vec3i>& found) const;
    void dropUnreached(std::size_t known);
    void add(Block block);
    Block sample(BlockSampler& sampler, const Vec3i& at) const;
    Block uniformBlock(const Vec3i& at, bool inside) const;
    void ensureLeaf(Block& block);
    std::size_t countData(const Vec3i& block, const SignWords& voxels) const;
    float deepestOf(const Block& block, const SignWords& voxels) const;
    /// Whether the field is made from data; else all of it counts as supported.
    bool isFromData() const;
    void turn(Block& block, const SignWords& voxels);
    Regions labelRegions() const;
    std::size_t turnIslands();
    BlockMosaic mosaic() const;
    bool isSupported(const std::vector<VoxelId>& voxels, double deepest, bool isThinPart) const;
    void checkMemory() const;
    bool isInReach(const Vec3i& at) const;
    void checkReach(const Vec3i& at) const;
    bool isKnown(const Vec3i& at) const { return !mZone || mZone->known.holds(at); }
    bool isWanted(const Vec3i& at) const { return mZone && mZone->wanted.holds(at); }
    bool isAtBorder(const Vec3i& at) const
    {
        return mZone && ((at.array() == mZone->known.first.array()).any() ||
                         (at.array() == mZone->known.last.array()).any());
    }
    bool reachesFar(const BlockMosaic& mosaic, std::vector<SignWords> narrow,
                    const std::vector<SignWords>& doubtful) const;

    const Field& mField;
    Lattice mLattice;
    float mBackground;
    std::uint64_t mMaxBytes;
    Interrupter& mProgress;
    std::optional<Zone> mZone;
    bool mIsCertain = true;
    Box3d mReach; ///< limit of the search, world units
    std::vector<Block> mBlocks;
    std::unordered_map<std::uint64_t, std::uint32_t> mIndex; ///< packed position -> block
    std::vector<std::pair<Vec3i, Vec3i>> mInsideRuns;        ///< first, last block; along z
};

} // namespace mpuvdb
