// The connected parts of a solid.
#pragma once
#include "grid/block_parts.h"

#include <mpuvdb/level_set.h>

#include <cstdint>
#include <unordered_map>
#include <vector>

namespace mpuvdb
{

class Interrupter;
class UnionFind;

/// The connected parts of a solid (as its mesh is, see DiagonalLinks), and of its band: a region is
/// a connected part of the voxels that are active or inside, and holds one or several parts of the
/// solid whose bands meet. Parts and regions are numbered by their first leaves.
class SolidParts
{
public:
    using Leaf = openvdb::FloatTree::LeafNodeType;

    /// Some voxels of a leaf.
    struct Piece {
        std::uint32_t leaf = 0;
        SignWords voxels{};
    };
    /// A tile that is inside.
    struct Tile {
        openvdb::Coord origin;
        openvdb::Index level = 0;
    };
    struct Part {
        std::vector<Piece> pieces; ///< by leaf
        std::vector<Tile> tiles;
        std::uint32_t region = 0;
    };
    struct Region {
        std::vector<Piece> pieces;
        std::vector<Tile> tiles;
        std::uint32_t parts = 0; ///< how many
    };

    SolidParts(const LevelSet& levelSet, Interrupter& progress);

    const std::vector<Part>& parts() const { return mParts; }
    /// The solid of @a chosen parts alone: values as they are where no removed part can be nearest,
    /// else distances to the chosen ones. Time is proportional to their size. @throws Interrupted.
    LevelSet extract(const std::vector<std::uint32_t>& chosen, Interrupter& progress) const;

private:
    /// Connected pieces; their tiles come after them.
    struct Labels;

    Labels label(bool band, Interrupter& progress) const;
    void joinTiles(UnionFind& nodes, std::uint32_t firstTile) const;
    void joinEdges(const Labels& labels, UnionFind& nodes, Interrupter& progress) const;
    void joinStrays(Labels& labels, UnionFind& nodes) const;
    void findTiles();
    std::uint32_t tileAt(const openvdb::Coord& at) const;
    std::vector<Piece> piecesNear(const std::vector<std::uint32_t>& parts, const Region& region,
                                  double distance, Interrupter& progress) const;
    openvdb::MaskTree removedOf(const std::vector<Piece>& pieces,
                                const openvdb::FloatTree& broken) const;
    void takeBack(const std::vector<Piece>& pieces, openvdb::MaskTree removed,
                  openvdb::FloatTree& tree) const;
    void takeBackBelow(float most, int steps, const std::vector<Piece>& pieces,
                       openvdb::MaskTree& removed, openvdb::FloatTree& tree) const;
    enum class Side { AsIs, Outside };
    void copy(const std::vector<Piece>& pieces, Side side, openvdb::FloatTree& tree,
              Interrupter& progress) const;
    static void fill(const std::vector<Tile>& tiles, openvdb::FloatTree& tree);

    LevelSet mLevelSet;
    std::vector<const Leaf*> mLeaves;
    std::unordered_map<openvdb::Coord, std::uint32_t> mLeafAt;
    std::vector<Tile> mTiles;
    std::unordered_map<openvdb::Coord, std::uint32_t> mTileAt;
    std::vector<Part> mParts;
    std::vector<Region> mRegions;
};

} // namespace mpuvdb
