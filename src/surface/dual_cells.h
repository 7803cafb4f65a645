// The cells that the surface crosses, block by block, and the numbers of their vertices.
#pragma once
#include "cell_sheets.h"
#include "grid/leaf_halo.h"
#include <mpuvdb/vec.h>

#include <array>
#include <cstdint>
#include <functional>
#include <openvdb/openvdb.h>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// Values of a block's voxels and those around it that its cells use.
using BlockHalo = BlockWindow<2, 3>;

/// A cell that the surface crosses; its corners are its voxel and those one step up the axes.
struct DualCell {
    std::uint16_t vertex; ///< its first vertex, counted from the block's first
    std::uint8_t inside;  ///< corners inside
    std::uint8_t joined;  ///< ambiguous faces whose inside corners are joined

    const CellSheets& sheets() const { return cellSheets(inside, joined); }
};

/// Number of bits in each byte; a table, as not all processors have an instruction for it.
extern const std::array<std::uint8_t, 256> kBitCounts;

/// The cells whose voxels lie in one block of 8 x 8 x 8.
struct DualBlock {
    static constexpr std::uint32_t kNone =
        ~std::uint32_t(0); ///< no block [derived: type's largest]

    openvdb::Coord origin;
    /// Numbers of this block and its lower neighbors: bits 4, 2, 1 are steps down x, y, z.
    std::array<std::uint32_t, 8> near{};
    std::array<std::uint64_t, 8> passed{}; ///< bit z + 8 y of word x
    std::array<std::uint16_t, 64> rank{};  ///< passed cells before row y + 8 x along z
    std::vector<DualCell> cells;           ///< in the order of the bits
    std::uint64_t firstVertex = 0, vertices = 0;
    std::uint64_t firstQuad = 0, quads = 0;

    /// The cell at a passed place (x,y,z), each in [0,7].
    const DualCell& cell(int x, int y, int z) const
    {
        const auto row = std::size_t(passed[std::size_t(x)] >> (8 * y) & 0xff);
        return cells[rank[8 * std::size_t(x) + std::size_t(y)] +
                     kBitCounts[row & ((std::size_t(1) << z) - 1)]];
    }

    /// Calls visit(at, cell) for all its cells, at in [0,7] per axis.
    template <typename Visit>
    void forEachCell(const Visit& visit) const
    {
        auto next = cells.begin();
        for (int x = 0; x < 8; ++x)
            for (std::uint64_t bits = passed[std::size_t(x)]; bits; bits &= bits - 1) {
                const int bit = __builtin_ctzll(bits);
                visit(Vec3i(x, bit >> 3, bit & 7), *next++);
            }
    }
};

/// Whether the block with this first voxel counts.
using BlockFilter = std::function<bool(const openvdb::Coord&)>;

/// All blocks that the surface crosses.
class DualCells
{
public:
    /// @param only  blocks to look at, or null. @throws Interrupted.
    DualCells(const openvdb::FloatTree& tree, double voxelSize, Interrupter& progress,
              const BlockFilter& only = {});

    const std::vector<DualBlock>& blocks() const { return mBlocks; }
    std::uint64_t vertices() const { return mVertices; }
    std::uint64_t quads() const { return mQuads; }

    /// Calls visit(quad, corners, outwards) for every edge that the surface crosses in block @a n;
    /// corners are vertices, counter-clockwise seen from outside; quad counts from the block's
    /// first; outwards is the edge's axis if it leads out of the solid, else 3 more.
    template <typename Visit>
    void forEachQuad(std::size_t n, const Visit& visit) const;

    /// The block in which vertex @a v lies.
    std::size_t blockOf(std::uint64_t v) const;
    /// The blocks with a flag in @a selection and those whose quads reach into them.
    std::vector<char> withNeighbors(const std::vector<char>& selection) const;

private:
    void add(const openvdb::FloatTree& tree, const std::vector<openvdb::Coord>& origins,
             float voxelSize, Interrupter& progress);
    void number();

    std::vector<DualBlock> mBlocks;
    std::uint64_t mVertices = 0, mQuads = 0;
};

template <typename Visit>
void DualCells::forEachQuad(std::size_t n, const Visit& visit) const
{
    const DualBlock& block = mBlocks[n];
    // The vertex of the sheet that crosses edge e of the cell at a place in [-1,7] per axis.
    const auto vertexAt = [&](const Vec3i& at, int e) {
        const int step = (at.x() < 0 ? 4 : 0) | (at.y() < 0 ? 2 : 0) | (at.z() < 0 ? 1 : 0);
        const DualBlock& home = mBlocks[block.near[std::size_t(step)]];
        const DualCell& cell = home.cell(at.x() & 7, at.y() & 7, at.z() & 7);
        return std::uint32_t(home.firstVertex + cell.vertex + cell.sheets().sheet[std::size_t(e)]);
    };
    std::uint64_t quad = 0;
    block.forEachCell([&](const Vec3i& at, const DualCell& cell) {
        const bool inside = cell.inside & 1;
        for (int axis = 0; axis < 3; ++axis) {
            if (((cell.inside >> (4 >> axis) & 1) != 0) == inside) continue;
            const Vec3i u = Vec3i::Unit((axis + 1) % 3), w = Vec3i::Unit((axis + 2) % 3);
            const int e = 4 * axis;
            std::array<std::uint32_t, 4> corners = {vertexAt(at, e), vertexAt(at - u, e + 2),
                                                    vertexAt(at - u - w, e + 3),
                                                    vertexAt(at - w, e + 1)};
            if (!inside) std::swap(corners[1], corners[3]);
            visit(quad++, corners, inside ? axis : axis + 3);
        }
    });
}

} // namespace mpuvdb
