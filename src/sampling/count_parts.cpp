#include "count_parts.h"

#include "core/union_find.h"
#include "solid_blocks.h"
#include "surface/diagonal_links.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using Place = SolidBlocks::Place;
using Lower = SolidBlocks::Lower;
using Slots = SolidBlocks::Slots;

constexpr openvdb::Index kSlotBits = Lower::LOG2DIM; ///< bits per axis [derived: the node's edge]
/// Masks of a word's slots that are first and last along z. [derived: 16 slots in a row]
constexpr std::uint64_t kFirstSlots = 0x0001000100010001u, kLastSlots = kFirstSlots << 15;

/// Word @a w of the slots whose upper neighbors on @a axis are in the node and among @a slots.
std::uint64_t below(const Slots& slots, int axis, std::size_t w)
{
    if (axis == 0) return w + 4 < slots.size() ? slots[w + 4] : 0;
    if (axis == 1) return slots[w] >> 16 | (w % 4 < 3 ? slots[w + 1] << 48 : 0);
    return slots[w] >> 1 & ~kLastSlots;
}

/// Call @a f(slot) for each bit of word @a w.
template <class F>
void forEachBit(std::uint64_t word, std::size_t w, const F& f)
{
    for (; word; word &= word - 1)
        f(openvdb::Index(64 * w) + openvdb::Index(__builtin_ctzll(word)));
}

/// Call @a f(low, high) for each slot at a lower node's lower face across @a axis and the opposite
/// slot.
template <class F>
void forEachSlotOfFace(int axis, const F& f)
{
    constexpr openvdb::Index kSide = 1u << kSlotBits; ///< slots per axis [derived: kSlotBits]
    const auto shiftOf = [](int a) { return kSlotBits * openvdb::Index(2 - a); };
    const int u = axis == 0 ? 1 : 0, v = axis == 2 ? 1 : 2;
    for (openvdb::Index i = 0; i < kSide; ++i)
        for (openvdb::Index j = 0; j < kSide; ++j) {
            const openvdb::Index low = i << shiftOf(u) | j << shiftOf(v);
            f(low, low | (kSide - 1) << shiftOf(axis));
        }
}

/// The connected pieces of all leaves: those outside, then those inside, leaf by leaf.
class LeafPieces
{
public:
    LeafPieces(const SolidBlocks& blocks, Interrupter& progress)
    {
        constexpr std::size_t kTogether = 256; ///< leaves of a task [free: time]
        const std::size_t leaves = blocks.leaves().size();
        mFirst.resize(2 * leaves + 1);
        std::vector<std::vector<SignWords>> chunks((leaves + kTogether - 1) / kTogether);
        tbb::parallel_for(std::size_t(0), chunks.size(), [&](std::size_t chunk) {
            progress.check();
            const std::size_t end = std::min((chunk + 1) * kTogether, leaves);
            for (std::size_t n = chunk * kTogether; n < end; ++n)
                for (const bool inside : {false, true}) {
                    SignWords words = blocks.insideOf(n);
                    if (!inside)
                        for (std::uint64_t& word : words) word = ~word;
                    mFirst[2 * n + inside] = std::uint32_t(chunks[chunk].size());
                    appendConnectedParts(words, chunks[chunk]);
                }
        });
        for (std::size_t chunk = 0; chunk < chunks.size(); ++chunk) {
            const std::size_t end = std::min((chunk + 1) * kTogether, leaves);
            for (std::size_t n = 2 * chunk * kTogether; n < 2 * end; ++n) mFirst[n] += count();
            mPieces.insert(mPieces.end(), chunks[chunk].begin(), chunks[chunk].end());
        }
        mFirst.back() = count();
    }

    std::uint32_t count() const { return std::uint32_t(mPieces.size()); }
    const SignWords& operator[](std::uint32_t n) const { return mPieces[n]; }
    /// Range of the pieces of one side of a leaf: [first(), end()).
    std::uint32_t first(std::uint32_t leaf, bool inside) const { return mFirst[2 * leaf + inside]; }
    std::uint32_t end(std::uint32_t leaf, bool inside) const
    {
        return mFirst[2 * leaf + inside + 1];
    }

private:
    std::vector<SignWords> mPieces;
    std::vector<std::uint32_t> mFirst; ///< by leaf and side
};

/// The connected parts of a solid and of its complement. All space beyond the tree is one node.
class SolidForest
{
public:
    SolidForest(const LevelSet& levelSet, const SolidBlocks& blocks, Interrupter& progress)
        : mLevelSet(levelSet), mBlocks(blocks), mPieces(blocks, progress),
          mLowerTiles(mPieces.count()),
          mUpperTiles(mLowerTiles + std::uint32_t(blocks.lowers().size()) * Lower::NUM_VALUES),
          mRoot(mUpperTiles + blocks.upperTiles()), mNodes(mRoot + 1)
    {
        joinAll(progress);
    }

    /// Join the parts that touch at edges alone where the surface does.
    void joinEdges(Interrupter& progress)
    {
        const DiagonalLinks links(mLevelSet.grid().tree(), mLevelSet.voxelSize());
        for (const Coord& origin : blocksBetweenParts()) {
            progress.check();
            links.forEach(origin, [&](const Coord& a, const Coord& b, bool inside) {
                mNodes.join(nodeAt(a, inside), nodeAt(b, inside));
            });
        }
    }

    /// Count the parts of at least @a least voxels, or as many as the largest part of the solid
    /// has, without the surrounding space.
    PartCounts count(std::uint64_t least)
    {
        std::vector<std::uint64_t> voxels(mPieces.count()); // by root: pieces come before tiles
        for (std::uint32_t n = 0; n < mPieces.count(); ++n)
            voxels[mNodes.find(n)] += countVoxels(mPieces[n]);
        PartCounts counts;
        const std::uint32_t around = mNodes.find(mRoot);
        std::uint64_t largest = 1;
        forEachPiece([&](std::uint32_t, bool inside, std::uint32_t n) {
            if (inside) largest = std::max(largest, voxels[n]);
        });
        least = std::min(least, largest);
        forEachPiece([&](std::uint32_t, bool inside, std::uint32_t n) {
            if (n != around && voxels[n] >= least) ++(inside ? counts.parts : counts.cavities);
        });
        return counts;
    }

private:
    /// The blocks in which links may join two parts: those with a piece of another part than the
    /// widest and the space around, and the ones below them.
    std::vector<Coord> blocksBetweenParts()
    {
        std::vector<std::uint32_t> pieces(mPieces.count()); // by root
        forEachPiece([&](std::uint32_t, bool inside, std::uint32_t n) {
            if (inside) ++pieces[mNodes.find(n)];
        });
        const auto widest =
            std::uint32_t(std::max_element(pieces.begin(), pieces.end()) - pieces.begin());
        const std::uint32_t around = mNodes.find(mRoot);
        std::vector<Coord> blocks;
        forEachPiece([&](std::uint32_t leaf, bool, std::uint32_t n) {
            const std::uint32_t part = mNodes.find(n);
            if (part == widest || part == around) return;
            const Coord& origin = mBlocks.leaves()[leaf]->origin();
            for (int step = 0; step < 8; ++step)
                blocks.push_back(
                    origin.offsetBy(-(step & 4) * 2, -(step & 2) * 4, -(step & 1) * 8));
        });
        std::sort(blocks.begin(), blocks.end());
        blocks.erase(std::unique(blocks.begin(), blocks.end()), blocks.end());
        return blocks;
    }

    /// Calls @a f(leaf, inside, number) for all pieces.
    template <class F>
    void forEachPiece(const F& f) const
    {
        for (std::uint32_t leaf = 0; leaf < mBlocks.leaves().size(); ++leaf)
            for (const bool inside : {false, true})
                for (std::uint32_t n = mPieces.first(leaf, inside); n < mPieces.end(leaf, inside);
                     ++n)
                    f(leaf, inside, n);
    }

    std::uint32_t nodeOf(const Place& tile) const
    {
        return tile.kind == Place::LowerTile   ? mLowerTiles + tile.index
               : tile.kind == Place::UpperTile ? mUpperTiles + tile.index
                                               : mRoot;
    }

    /// Join the parts that touch across the face between @a a and its upper neighbor @a b on @a
    /// axis.
    void join(const Place& a, const Place& b, int axis)
    {
        const bool leafA = a.kind == Place::InLeaf, leafB = b.kind == Place::InLeaf;
        if (leafA && leafB) {
            for (const bool inside : {false, true}) joinLeaves(a.index, b.index, inside, axis);
        } else if (leafA || leafB) {
            const Place &leaf = leafA ? a : b, &tile = leafA ? b : a;
            const std::uint32_t end = mPieces.end(leaf.index, tile.isInside);
            for (std::uint32_t n = mPieces.first(leaf.index, tile.isInside); n < end; ++n)
                if (reachesFace(mPieces[n], axis, leafA)) mNodes.join(n, nodeOf(tile));
        } else if (a.isInside == b.isInside) {
            mNodes.join(nodeOf(a), nodeOf(b));
        }
    }

    void joinLeaves(std::uint32_t a, std::uint32_t b, bool inside, int axis)
    {
        for (std::uint32_t p = mPieces.first(a, inside); p < mPieces.end(a, inside); ++p)
            for (std::uint32_t q = mPieces.first(b, inside); q < mPieces.end(b, inside); ++q)
                if (meet(mPieces[p], mPieces[q], axis)) mNodes.join(p, q);
    }

    /// Join the parts in one lower node; for different nodes from different threads.
    void joinWithin(std::uint32_t node)
    {
        const Slots &leaves = mBlocks.lowers()[node].leaves,
                    &inside = mBlocks.lowers()[node].insideTiles;
        Slots outside{}, all{};
        all.fill(~std::uint64_t(0));
        for (std::size_t w = 0; w < all.size(); ++w) outside[w] = ~(leaves[w] | inside[w]);
        const std::uint32_t firstTile = mLowerTiles + node * Lower::NUM_VALUES;
        for (const int axis : {2, 1, 0}) {
            const openvdb::Index up = 1u << kSlotBits * (2 - axis);
            for (std::size_t w = 0; w < all.size(); ++w) {
                for (const Slots* const tiles : {&inside, static_cast<const Slots*>(&outside)}) {
                    std::uint64_t meeting = (*tiles)[w] & below(*tiles, axis, w);
                    // Rows along z are joined before: the first pair of two rows joins all.
                    if (axis < 2) meeting &= ~(meeting << 1 & ~kFirstSlots);
                    forEachBit(meeting, w, [&](openvdb::Index slot) {
                        mNodes.join(firstTile + slot, firstTile + slot + up);
                    });
                }
                const std::uint64_t leafAbove = below(leaves, axis, w);
                forEachBit(
                    (leaves[w] & below(all, axis, w)) | leafAbove, w, [&](openvdb::Index slot) {
                        join(mBlocks.inLower(node, slot), mBlocks.inLower(node, slot + up), axis);
                    });
            }
        }
    }

    /// Join a lower node's slots with their neighbors beyond its upper faces, and with larger tiles
    /// beyond its lower ones.
    void joinFaces(std::uint32_t node)
    {
        for (int axis = 0; axis < 3; ++axis) {
            const Coord& origin = mBlocks.lowers()[node].origin;
            Coord above = origin, below = origin;
            above[axis] += int(Lower::DIM);
            below[axis] -= 1;
            const std::optional<std::uint32_t> next = mBlocks.lowerAt(above);
            const Place wide = next ? Place() : mBlocks.at(above);
            forEachSlotOfFace(axis, [&](openvdb::Index low, openvdb::Index high) {
                join(mBlocks.inLower(node, high), next ? mBlocks.inLower(*next, low) : wide, axis);
            });
            if (mBlocks.lowerAt(below)) continue; // that node joins them
            const Place wideBelow = mBlocks.at(below);
            forEachSlotOfFace(axis, [&](openvdb::Index low, openvdb::Index) {
                join(wideBelow, mBlocks.inLower(node, low), axis);
            });
        }
    }

    /// Join an upper node's tiles with those above them, and with larger tiles below them.
    void joinTiles(std::uint32_t node)
    {
        mBlocks.forEachTile(node, [&](const Place& tile, const Coord& origin) {
            for (int axis = 0; axis < 3; ++axis) {
                Coord above = origin, below = origin;
                above[axis] += int(Lower::DIM);
                below[axis] -= 1;
                const Place next = mBlocks.at(above), last = mBlocks.at(below);
                if (next.kind <= Place::UpperTile) join(tile, next, axis);
                if (last.kind == Place::Root) join(last, tile, axis);
            }
        });
    }

    void joinAll(Interrupter& progress)
    {
        const auto lowers = std::uint32_t(mBlocks.lowers().size());
        tbb::parallel_for(std::uint32_t(0), lowers, [&](std::uint32_t n) {
            progress.check();
            joinWithin(n);
        });
        for (std::uint32_t n = 0; n < lowers; ++n) {
            progress.check();
            joinFaces(n);
        }
        for (std::uint32_t n = 0; n < mBlocks.uppers(); ++n) joinTiles(n);
    }

    /// The node of the voxel @a at.
    std::uint32_t nodeAt(const Coord& at, bool inside) const
    {
        const Place place = mBlocks.at(at);
        if (place.kind != Place::InLeaf) return nodeOf(place);
        const auto bit = std::size_t((at[1] & 7) << 3 | (at[2] & 7));
        std::uint32_t piece = mPieces.first(place.index, inside);
        while (!(mPieces[piece][std::size_t(at[0] & 7)] >> bit & 1)) ++piece;
        return piece;
    }

    const LevelSet& mLevelSet;
    const SolidBlocks& mBlocks;
    const LeafPieces mPieces;
    const std::uint32_t mLowerTiles, mUpperTiles, mRoot; ///< nodes: pieces come first
    UnionFind mNodes;
};

} // namespace

PartCounts countParts(const LevelSet& levelSet, const SolidBlocks& blocks, Interrupter& progress)
{
    /// Voxels of a part or cavity. [derived: two along each axis]
    constexpr std::uint64_t kMinVoxels = 8;
    SolidForest forest(levelSet, blocks, progress);
    const PartCounts byFaces = forest.count(1);
    if (byFaces.parts + byFaces.cavities < 2) return forest.count(kMinVoxels);
    forest.joinEdges(progress);
    return forest.count(kMinVoxels);
}

} // namespace mpuvdb
