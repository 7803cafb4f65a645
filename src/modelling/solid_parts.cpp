#include "solid_parts.h"

#include "core/union_find.h"
#include "surface/diagonal_links.h"
#include <mpuvdb/interrupter.h>
#include <mpuvdb/operations.h>

#include <openvdb/tools/Composite.h>
#include <openvdb/tools/Morphology.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using openvdb::FloatGrid;
using openvdb::FloatTree;
using Leaf = SolidParts::Leaf;

constexpr int kLeaf = int(Leaf::DIM); ///< edge of a leaf, voxels [derived: OpenVDB's leaves]
constexpr std::uint32_t kNone = ~0u;  ///< no index [derived: the largest of its type]

SignWords insideOf(const Leaf& leaf)
{
    return wordsWhere(leaf.buffer().data(), [](float value) { return value < 0; });
}

SignWords regionOf(const Leaf& leaf)
{
    SignWords words = insideOf(leaf);
    for (std::size_t x = 0; x < words.size(); ++x)
        words[x] |= leaf.getValueMask().getWord<std::uint64_t>(openvdb::Index(x));
    return words;
}

bool contains(const SignWords& words, openvdb::Index voxel)
{
    return words[voxel / 64] >> voxel % 64 & 1u;
}

openvdb::Index firstVoxel(const SignWords& words)
{
    std::size_t x = 0;
    while (!words[x]) ++x;
    return openvdb::Index(x * 64 + std::size_t(__builtin_ctzll(words[x])));
}

/// Calls @a f(index) for all voxels.
template <typename F>
void forEachVoxel(const SignWords& words, F f)
{
    for (std::size_t x = 0; x < words.size(); ++x)
        for (std::uint64_t rest = words[x]; rest; rest &= rest - 1)
            f(openvdb::Index(x * 64 + std::size_t(__builtin_ctzll(rest))));
}

Coord neighbor(const Coord& at, int face, int distance = 1)
{
    Coord next = at;
    next[face / 2] += face % 2 ? distance : -distance;
    return next;
}

int dimOf(openvdb::Index level)
{
    using Lower = FloatTree::RootNodeType::ChildNodeType::ChildNodeType;
    using Upper = FloatTree::RootNodeType::ChildNodeType;
    return level == 1 ? kLeaf : level == 2 ? int(Lower::DIM) : int(Upper::DIM);
}

} // namespace

struct SolidParts::Labels {
    std::vector<Piece> pieces;        ///< by leaf
    std::vector<std::uint32_t> first; ///< of each leaf, and the end
    std::vector<std::uint32_t> roots; ///< of pieces, then of tiles

    /// The piece that holds a voxel of a leaf; kNone if none does.
    std::uint32_t pieceAt(std::uint32_t leaf, openvdb::Index voxel) const
    {
        for (std::uint32_t p = first[leaf]; p < first[leaf + 1]; ++p)
            if (contains(pieces[p].voxels, voxel)) return p;
        return kNone;
    }
};

SolidParts::SolidParts(const LevelSet& levelSet, Interrupter& progress) : mLevelSet(levelSet)
{
    levelSet.grid().tree().getNodes(mLeaves);
    for (std::size_t n = 0; n < mLeaves.size(); ++n)
        mLeafAt.emplace(mLeaves[n]->origin(), std::uint32_t(n));
    findTiles();
    const Labels solid = label(false, progress), band = label(true, progress);
    const auto tiles = std::uint32_t(mTiles.size());
    const auto pieces = std::uint32_t(solid.pieces.size());
    const auto bandPieces = std::uint32_t(band.pieces.size());

    std::unordered_map<std::uint32_t, std::uint32_t> regionOfRoot, partOfRoot;
    for (std::uint32_t n = 0; n < pieces + tiles; ++n) {
        const bool isTile = n >= pieces;
        const auto [part, isNew] = partOfRoot.emplace(solid.roots[n], std::uint32_t(mParts.size()));
        if (isNew) {
            const std::uint32_t inBand =
                isTile ? bandPieces + n - pieces
                       : band.pieceAt(solid.pieces[n].leaf, firstVoxel(solid.pieces[n].voxels));
            const auto [region, isFirst] =
                regionOfRoot.emplace(band.roots[inBand], std::uint32_t(mRegions.size()));
            if (isFirst) mRegions.emplace_back();
            ++mRegions[region->second].parts;
            mParts.emplace_back().region = region->second;
        }
        if (isTile)
            mParts[part->second].tiles.push_back(mTiles[n - pieces]);
        else
            mParts[part->second].pieces.push_back(solid.pieces[n]);
    }
    for (std::uint32_t n = 0; n < bandPieces + tiles; ++n) {
        const auto region = regionOfRoot.find(band.roots[n]);
        if (region == regionOfRoot.end()) continue; // active voxels far from any solid
        if (n < bandPieces)
            mRegions[region->second].pieces.push_back(band.pieces[n]);
        else
            mRegions[region->second].tiles.push_back(mTiles[n - bandPieces]);
    }
}

void SolidParts::findTiles()
{
    auto tile = mLevelSet.grid().tree().cbeginValueAll();
    tile.setMaxDepth(FloatTree::ValueAllCIter::LEAF_DEPTH - 1);
    for (; tile; ++tile) {
        if (!(*tile < 0)) continue;
        mTileAt.emplace(tile.getCoord(), std::uint32_t(mTiles.size()));
        mTiles.push_back({tile.getCoord(), tile.getLevel()});
    }
}

/// The tile that holds a voxel; kNone if none does.
std::uint32_t SolidParts::tileAt(const Coord& at) const
{
    for (const openvdb::Index level : {1, 2, 3}) {
        const auto found = mTileAt.find(at & ~(dimOf(level) - 1));
        if (found != mTileAt.end() && mTiles[found->second].level == level) return found->second;
    }
    return kNone;
}

SolidParts::Labels SolidParts::label(bool band, Interrupter& progress) const
{
    std::vector<std::vector<SignWords>> parts(mLeaves.size());
    tbb::parallel_for(std::size_t(0), mLeaves.size(), [&](std::size_t n) {
        if (n % 256 == 0) progress.check();
        parts[n] = connectedParts(band ? regionOf(*mLeaves[n]) : insideOf(*mLeaves[n]));
    });
    Labels labels;
    for (std::size_t n = 0; n < parts.size(); ++n) {
        labels.first.push_back(std::uint32_t(labels.pieces.size()));
        for (const SignWords& words : parts[n]) labels.pieces.push_back({std::uint32_t(n), words});
    }
    const auto tiles = std::uint32_t(labels.pieces.size());
    labels.first.push_back(tiles);
    UnionFind nodes(tiles + mTiles.size());
    for (std::uint32_t n = 0; n < tiles; ++n) {
        if (n % 1024 == 0) progress.check();
        const Piece& piece = labels.pieces[n];
        for (int face = 0; face < 6; ++face) {
            const int axis = face / 2;
            if (!reachesFace(piece.voxels, axis, face % 2)) continue;
            const Coord beyond = neighbor(mLeaves[piece.leaf]->origin(), face, kLeaf);
            const auto next = mLeafAt.find(beyond);
            if (next == mLeafAt.end()) {
                const std::uint32_t tile = tileAt(beyond);
                if (tile != kNone) nodes.join(n, tiles + tile);
            } else if (face % 2) {
                for (std::uint32_t m = labels.first[next->second];
                     m < labels.first[next->second + 1]; ++m)
                    if (meet(piece.voxels, labels.pieces[m].voxels, axis)) nodes.join(n, m);
            }
        }
    }
    joinTiles(nodes, tiles);
    if (!band) joinEdges(labels, nodes, progress);
    labels.roots = nodes.roots();
    if (band) joinStrays(labels, nodes);
    return labels;
}

/// Joins tiles that touch: the smaller of two finds the larger.
void SolidParts::joinTiles(UnionFind& nodes, std::uint32_t firstTile) const
{
    for (std::uint32_t n = 0; n < mTiles.size(); ++n)
        for (int face = 0; face < 6; ++face) {
            const std::uint32_t other =
                tileAt(neighbor(mTiles[n].origin, face, face % 2 ? dimOf(mTiles[n].level) : 1));
            if (other != kNone) nodes.join(firstTile + n, firstTile + other);
        }
}

/// Joins the parts that touch at edges alone where the surface does.
void SolidParts::joinEdges(const Labels& labels, UnionFind& nodes, Interrupter& progress) const
{
    const auto nodeAt = [&](const Coord& at) {
        const auto leaf = mLeafAt.find(at & ~(kLeaf - 1));
        return leaf != mLeafAt.end() ? labels.pieceAt(leaf->second, Leaf::coordToOffset(at))
                                     : std::uint32_t(labels.pieces.size()) + tileAt(at);
    };
    const DiagonalLinks links(mLevelSet.grid().tree(), mLevelSet.voxelSize());
    for (const Leaf* const leaf : mLeaves) {
        progress.check();
        links.forEach(leaf->origin(), [&](const Coord& a, const Coord& b, bool inside) {
            if (inside) nodes.join(nodeAt(a), nodeAt(b));
        });
    }
}

/// Joins pieces without a part of the solid to all that they touch: at the band's rim single voxels
/// may touch others by edges or corners only.
void SolidParts::joinStrays(Labels& labels, UnionFind& nodes) const
{
    std::vector<bool> isSolid(labels.roots.size(), false);
    for (std::size_t n = 0; n < labels.roots.size(); ++n) {
        if (isSolid[labels.roots[n]]) continue;
        bool solid = n >= labels.pieces.size();
        if (!solid) {
            const SignWords inside = insideOf(*mLeaves[labels.pieces[n].leaf]);
            for (std::size_t x = 0; x < inside.size(); ++x)
                solid |= (inside[x] & labels.pieces[n].voxels[x]) != 0;
        }
        if (solid) isSolid[labels.roots[n]] = true;
    }
    for (std::uint32_t n = 0; n < labels.pieces.size(); ++n) {
        if (isSolid[labels.roots[n]]) continue;
        const Leaf& leaf = *mLeaves[labels.pieces[n].leaf];
        forEachVoxel(labels.pieces[n].voxels, [&](openvdb::Index voxel) {
            const Coord at = leaf.offsetToGlobalCoord(voxel);
            for (int k = 0; k < 27; ++k) {
                const Coord next = at.offsetBy(k / 9 - 1, k / 3 % 3 - 1, k % 3 - 1);
                const auto found = mLeafAt.find(next & ~(kLeaf - 1));
                if (found == mLeafAt.end()) continue;
                const std::uint32_t piece =
                    labels.pieceAt(found->second, Leaf::coordToOffset(next));
                if (piece != kNone) nodes.join(n, piece);
            }
        });
    }
    labels.roots = nodes.roots();
}

void SolidParts::copy(const std::vector<Piece>& pieces, Side side, FloatTree& tree,
                      Interrupter& progress) const
{
    for (std::size_t n = 0; n < pieces.size(); ++n) {
        if (n % 1024 == 0) progress.check();
        const Leaf& from = *mLeaves[pieces[n].leaf];
        Leaf& to = *tree.touchLeaf(from.origin());
        forEachVoxel(pieces[n].voxels, [&](openvdb::Index voxel) {
            const float v = from.getValue(voxel);
            to.setValueOnly(voxel, side == Side::Outside ? std::abs(v) : v);
            to.setActiveState(voxel, from.isValueOn(voxel));
        });
    }
}

void SolidParts::fill(const std::vector<Tile>& tiles, FloatTree& tree)
{
    for (const Tile& tile : tiles) tree.addTile(tile.level, tile.origin, -tree.background(), false);
}

/// The pieces of a region in leaves up to @a distance voxels from some of its parts.
std::vector<SolidParts::Piece> SolidParts::piecesNear(const std::vector<std::uint32_t>& parts,
                                                      const Region& region, double distance,
                                                      Interrupter& progress) const
{
    const int reach = (int(std::ceil(distance)) + kLeaf - 1) / kLeaf;
    std::vector<bool> isNear(mLeaves.size(), false);
    for (const std::uint32_t part : parts)
        for (const Piece& piece : mParts[part].pieces) {
            progress.check();
            for (int x = -reach; x <= reach; ++x)
                for (int y = -reach; y <= reach; ++y)
                    for (int z = -reach; z <= reach; ++z) {
                        const auto found = mLeafAt.find(mLeaves[piece.leaf]->origin().offsetBy(
                            x * kLeaf, y * kLeaf, z * kLeaf));
                        if (found != mLeafAt.end()) isNear[found->second] = true;
                    }
        }
    std::vector<Piece> near;
    std::copy_if(region.pieces.begin(), region.pieces.end(), std::back_inserter(near),
                 [&](const Piece& piece) { return isNear[piece.leaf]; });
    return near;
}

/// The voxels of @a pieces that are removed: outside in @a broken, inside before.
openvdb::MaskTree SolidParts::removedOf(const std::vector<Piece>& pieces,
                                        const FloatTree& broken) const
{
    openvdb::MaskTree removed;
    for (const Piece& piece : pieces) {
        const Leaf& from = *mLeaves[piece.leaf];
        SignWords inside = insideOf(from);
        for (std::size_t x = 0; x < inside.size(); ++x) inside[x] &= piece.voxels[x];
        const Leaf* const left = broken.probeConstLeaf(from.origin());
        if (left) {
            const SignWords kept = insideOf(*left);
            for (std::size_t x = 0; x < inside.size(); ++x) inside[x] &= ~kept[x];
        } else if (broken.getValue(from.origin()) < 0) {
            continue;
        }
        forEachVoxel(inside, [&](openvdb::Index voxel) {
            removed.touchLeaf(from.origin())->setValueOn(voxel);
        });
    }
    return removed;
}

/// Set the values of active voxels of @a pieces as they were, where no part of @a removed is as
/// near: its surface is up to a voxel from its voxels. First those beside the surface.
void SolidParts::takeBack(const std::vector<Piece>& pieces, openvdb::MaskTree removed,
                          FloatTree& tree) const
{
    const double halfWidth = mLevelSet.halfWidth();
    const auto voxel = float(mLevelSet.voxelSize());
    takeBackBelow(voxel, 1, pieces, removed, tree);
    takeBackBelow(float(halfWidth) * voxel, int(std::ceil(halfWidth)), pieces, removed, tree);
}

/// The same of values below @a most, after voxels as near were added to those removed.
void SolidParts::takeBackBelow(float most, int steps, const std::vector<Piece>& pieces,
                               openvdb::MaskTree& removed, FloatTree& tree) const
{
    openvdb::tools::dilateActiveValues(removed, steps, openvdb::tools::NN_FACE_EDGE_VERTEX,
                                       openvdb::tools::EXPAND_TILES);
    const auto voxel = float(mLevelSet.voxelSize());
    for (const Piece& piece : pieces) {
        const Leaf& from = *mLeaves[piece.leaf];
        Leaf* to = tree.probeLeaf(from.origin());
        const auto* const except = removed.probeConstLeaf(from.origin());
        forEachVoxel(piece.voxels, [&](openvdb::Index n) {
            const float v = from.getValue(n);
            if (!from.isValueOn(n) || !(std::abs(v) < most) || (except && except->isValueOn(n)))
                return;
            // Farther ones may be those of a removed part's other side.
            if (!(std::abs(v) < voxel) && !(to && to->isValueOn(n))) return;
            if (!to) to = tree.touchLeaf(from.origin());
            to->setValueOn(n, v);
        });
    }
}

LevelSet SolidParts::extract(const std::vector<std::uint32_t>& chosen, Interrupter& progress) const
{
    std::map<std::uint32_t, std::vector<std::uint32_t>> byRegion;
    for (const std::uint32_t part : chosen) byRegion[mParts[part].region].push_back(part);
    const auto whole = openvdb::gridPtrCast<FloatGrid>(mLevelSet.grid().copyGridWithNewTree());
    const FloatGrid::Ptr broken = whole->deepCopy();
    // Voxels that restored bands read beyond their own. [derived: as LinearMorph: neighbors, and
    // one for rounding]
    constexpr double kMargin = 2;
    const double halfWidth = mLevelSet.halfWidth();
    // In and about the bands of chosen parts, and what may be nearest to their voxels, or beside
    // the others of these leaves.
    const double about = halfWidth + kMargin, nearest = std::max(2 * about, about + kLeaf);
    std::vector<Piece> near, around;
    for (const auto& [index, parts] : byRegion) {
        const Region& region = mRegions[index];
        if (parts.size() == region.parts) {
            copy(region.pieces, Side::AsIs, whole->tree(), progress);
            fill(region.tiles, whole->tree());
            continue;
        }
        // Removed parts become outside: their values are wrong, but change smoothly near the rest.
        const std::vector<Piece> some = piecesNear(parts, region, about, progress);
        copy(some, Side::Outside, broken->tree(), progress);
        near.insert(near.end(), some.begin(), some.end());
        const auto more = piecesNear(parts, region, nearest, progress);
        around.insert(around.end(), more.begin(), more.end());
        for (const std::uint32_t part : parts) {
            copy(mParts[part].pieces, Side::AsIs, broken->tree(), progress);
            fill(mParts[part].tiles, broken->tree());
        }
    }
    if (broken->tree().empty()) return LevelSet(whole);
    const FloatGrid::Ptr made = redistance(*broken, halfWidth, &progress).grid().deepCopy();
    takeBack(near, removedOf(around, broken->tree()), made->tree());
    if (whole->tree().empty()) return LevelSet(made);
    openvdb::tools::csgUnion(*whole, *made);
    return LevelSet(whole);
}

} // namespace mpuvdb
