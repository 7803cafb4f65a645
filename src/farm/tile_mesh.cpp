#include "tile_mesh.h"

#include "io/vdb/leaf_files.h"
#include "mesh/dual_mesh.h"
#include "quiet.h"
#include <mpuvdb/error.h>

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <set>
#include <tbb/parallel_for.h>
#include <tuple>
#include <unordered_map>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using openvdb::CoordBBox;
using Vertices = DualMesh::Vertices;

/// Voxels below and above a part's cells that they need. [derived: whole leaves: a block below has
/// corners of the part's quads, and values four voxels beyond it decide its cells, see JoinedFaces]
constexpr int kBelow = 2 * kBlockDim, kAbove = kBlockDim;

/// Blocks by the order of leaves in OpenVDB's trees, whose nodes have 4096 and 128 voxels an edge.
auto treeOrder(const Coord& origin)
{
    constexpr int kUpper = 4096, kLower = 128; // [derived: OpenVDB's tree]
    return std::tuple(origin & ~(kUpper - 1), origin & ~(kLower - 1), origin);
}

/// A block that the surface crosses, and the numbers of what is in it.
struct NumberedBlock {
    Coord origin;
    bool isLeaf = true;
    std::uint64_t firstVertex = 0, firstQuad = 0;
    std::uint32_t vertices = 0, quads = 0;
};

/// A part's cells, those that its quads have corners in included.
struct Part {
    openvdb::FloatGrid::ConstPtr grid;
    std::unique_ptr<DualMesh> mesh;
    std::vector<const NumberedBlock*> blocks; ///< the numbers of its blocks
    DualMesh::Selection own;                  ///< blocks of the part
    Vertices numbers;                         ///< of its vertices, in the whole
};

class PartsMesher
{
public:
    PartsMesher(const PartedGrid& grid, const std::string& prefix, const ExtractSettings& settings,
                Interrupter& progress)
        : mGrid(grid), mPrefix(prefix), mProgress(progress), mQuiet(progress), mSettings(settings)
    {
        CoordBBox box;
        for (const auto& [cube, file] : grid.parts())
            for (const Coord& leaf : nodesWithLeaves(file, prefix, kBlockDim))
                box.expand(CoordBBox::createCube(leaf, kBlockDim));
        mFrame = meshFrame(box);
        // Cells belong to their lowest voxel, which may lie below all leaves of a part.
        std::set<Coord> cubes;
        for (const auto& [cube, file] : grid.parts())
            for (int step = 0; step < 8; ++step)
                cubes.insert(cube.offsetBy(-(step >> 2 & 1), -(step >> 1 & 1), -(step & 1)));
        mCubes.assign(cubes.begin(), cubes.end());
    }

    Mesh run(std::uint64_t maxBytes)
    {
        mProgress.beginStage("cells", double(mCubes.size()));
        for (const Coord& cube : mCubes) {
            count(cube);
            mProgress.advance();
        }
        number(maxBytes);
        mProgress.beginStage("mesh", double(mCubes.size()));
        Vertices folded;
        for (const Coord& cube : mCubes) {
            const Vertices found = make(cube, {});
            folded.insert(folded.end(), found.begin(), found.end());
            mProgress.advance();
        }
        while (retract(folded)) {
        }
        mProgress.endStage();
        if (mSettings.strict)
            for (Vertices found = crossingVertices(mMesh, mProgress); retract(found);
                 found = crossingVertices(mMesh, mProgress)) {
            }
        return std::move(mMesh);
    }

private:
    /// The values about @a cube; null without leaves. @param wanted  blocks whose leaves are read.
    openvdb::FloatGrid::Ptr read(const Coord& cube, const BlockFilter& wanted)
    {
        CoordBBox box = mGrid.boxOf(cube);
        box.min() = box.min().offsetBy(-kBelow);
        box.max() = box.max().offsetBy(kAbove);
        const std::vector<ArrayFile> files = mGrid.filesIn(box);
        if (files.empty()) return nullptr;
        auto grid = openvdb::gridPtrCast<openvdb::FloatGrid>(
            readLeaves(files, mPrefix, box, mQuiet, wanted));
        return grid->tree().leafCount() > 0 ? grid : nullptr;
    }

    void count(const Coord& cube)
    {
        const auto grid = read(cube, {});
        if (!grid) return;
        const CoordBBox box = mGrid.boxOf(cube);
        const DualCells cells(grid->tree(), mGrid.lattice().voxelSize, mQuiet,
                              [&](const Coord& block) { return box.isInside(block); });
        for (const DualBlock& block : cells.blocks()) {
            NumberedBlock numbered;
            numbered.origin = block.origin;
            numbered.isLeaf = grid->tree().probeConstLeaf(block.origin) != nullptr;
            numbered.vertices = std::uint32_t(block.vertices);
            numbered.quads = std::uint32_t(block.quads);
            mBlocks.push_back(numbered);
        }
    }

    /// Numbers all vertices and quads as DualCells does: those of leaves in the order of the tree,
    /// then others, which a closed band has right below its leaves alone.
    void number(std::uint64_t maxBytes)
    {
        std::sort(
            mBlocks.begin(), mBlocks.end(), [](const NumberedBlock& a, const NumberedBlock& b) {
                if (a.isLeaf != b.isLeaf) return a.isLeaf;
                return a.isLeaf ? treeOrder(a.origin) < treeOrder(b.origin) : a.origin < b.origin;
            });
        std::uint64_t vertices = 0, quads = 0;
        for (NumberedBlock& block : mBlocks) {
            block.firstVertex = vertices;
            block.firstQuad = quads;
            vertices += block.vertices;
            quads += block.quads;
            mIndex.emplace(block.origin, &block);
        }
        const double bytes =
            double(vertices) * sizeof(Vec3f) + 2 * double(quads) * sizeof(Mesh::Triangle);
        if (vertices > std::numeric_limits<std::uint32_t>::max())
            throw LimitError(fmt::format("mesh: would have {} vertices, more than 32 bits can "
                                         "number. Use larger voxels",
                                         vertices));
        if (maxBytes > 0 && bytes > double(maxBytes))
            throw LimitError(fmt::format("mesh: its {} vertices and {} triangles take {:.0f} MB, "
                                         "and {:.0f} are allowed. Allow more memory, or mesh a "
                                         "coarser level",
                                         vertices, 2 * quads, bytes / 1e6, double(maxBytes) / 1e6));
        const Lattice& lattice = mGrid.lattice();
        mMesh.frame =
            lattice.origin + lattice.voxelSize * Vec3d(mFrame.x(), mFrame.y(), mFrame.z());
        mMesh.positions.resize(vertices);
        mMesh.triangles.resize(2 * quads);
    }

    /// The cells of @a cube and those below, placed. @param again  vertices that count as new (see
    /// DualMesh::placeAll()), and alone are asked for; none: all do.
    Part partAt(const Coord& cube, const Vertices& again)
    {
        Part part;
        const std::set<Coord> needed = blocksAbout(again);
        const auto isNeeded = [&](const Coord& block, int from, int to) {
            if (again.empty()) return true;
            for (int x = from; x <= to; ++x)
                for (int y = from; y <= to; ++y)
                    for (int z = from; z <= to; ++z)
                        if (needed.count(block.offsetBy(8 * x, 8 * y, 8 * z)) > 0) return true;
            return false;
        };
        part.grid = read(cube, [&](const Coord& leaf) { return isNeeded(leaf, -1, 2); });
        if (!part.grid) return part;
        const CoordBBox own = mGrid.boxOf(cube);
        CoordBBox box = own;
        box.min() = box.min().offsetBy(-kBlockDim);
        part.mesh = std::make_unique<DualMesh>(
            part.grid->tree(), mGrid.lattice(), mFrame, mSettings,
            [&](const Coord& block) { return box.isInside(block) && isNeeded(block, 0, 1); },
            mQuiet);
        Vertices news;
        for (const DualBlock& block : part.mesh->cells().blocks()) {
            const NumberedBlock* const numbered = numberedAt(block.origin);
            part.blocks.push_back(numbered);
            part.own.push_back(own.isInside(block.origin) &&
                               (again.empty() || needed.count(block.origin) > 0));
            for (std::uint64_t v = 0; v < block.vertices; ++v)
                part.numbers.push_back(std::uint32_t(numbered->firstVertex + v));
            const auto local = [&](std::uint32_t v) {
                return std::uint32_t(block.firstVertex + (v - numbered->firstVertex));
            };
            const std::uint64_t end = numbered->firstVertex + numbered->vertices;
            for (auto v = mFreedoms.lower_bound(std::uint32_t(numbered->firstVertex));
                 v != mFreedoms.end() && v->first < end; ++v)
                part.mesh->setFreedom(local(v->first), v->second);
            for (auto v = std::lower_bound(again.begin(), again.end(), numbered->firstVertex);
                 v != again.end() && *v < end; ++v)
                news.push_back(local(*v));
        }
        part.mesh->placeAll(news);
        return part;
    }

    /// The blocks whose quads have @a vertices for corners.
    std::set<Coord> blocksAbout(const Vertices& vertices) const
    {
        std::set<Coord> blocks;
        for (const std::uint32_t v : vertices) {
            const Coord& origin = blockOf(v).origin;
            for (int step = 0; step < 8; ++step)
                blocks.insert(
                    origin.offsetBy(8 * (step >> 2 & 1), 8 * (step >> 1 & 1), 8 * (step & 1)));
        }
        return blocks;
    }

    /// Makes the vertices and the triangles of @a cube. @param again  as partAt(). @return the
    /// vertices of triangles that fold over.
    Vertices make(const Coord& cube, const Vertices& again)
    {
        Part part = partAt(cube, again);
        if (!part.mesh) return {};
        Vertices folded = part.mesh->split(part.own);
        for (std::uint32_t& v : folded) v = part.numbers[v];
        tbb::parallel_for(std::size_t(0), part.blocks.size(), [&](std::size_t n) {
            mQuiet.check();
            if (part.own[n]) copyBlock(part, n);
        });
        return folded;
    }

    /// Copies what a part has made of a block.
    void copyBlock(const Part& part, std::size_t n)
    {
        const Mesh& made = part.mesh->mesh();
        const DualBlock& from = part.mesh->cells().blocks()[n];
        const NumberedBlock& to = *part.blocks[n];
        std::copy_n(made.positions.begin() + std::ptrdiff_t(from.firstVertex), from.vertices,
                    mMesh.positions.begin() + std::ptrdiff_t(to.firstVertex));
        part.mesh->forEachNewQuad(n, [&](std::uint64_t quad) {
            const std::uint64_t at = to.firstQuad + (quad - from.firstQuad);
            for (std::uint64_t half = 0; half < 2; ++half)
                for (std::size_t c = 0; c < 3; ++c)
                    mMesh.triangles[2 * at + half][c] =
                        part.numbers[made.triangles[2 * quad + half][c]];
        });
    }

    /// As DualMesh::retract(), of all parts.
    bool retract(Vertices& found)
    {
        std::sort(found.begin(), found.end());
        found.erase(std::unique(found.begin(), found.end()), found.end());
        Vertices again;
        for (const std::uint32_t v : found) {
            Freedom& freedom = mFreedoms.emplace(v, Freedom::Near).first->second;
            if (freedom == Freedom::None) continue;
            freedom = Freedom(int(freedom) + 1);
            again.push_back(v);
        }
        if (again.empty()) return false;
        // Each part needs those of its own blocks, and of those below.
        std::map<Coord, Vertices> parts;
        for (const std::uint32_t v : again)
            for (const Coord& cube : cubesAbout(blockOf(v).origin)) parts[cube].push_back(v);
        found.clear();
        for (const auto& [cube, vertices] : parts) {
            const Vertices folded = make(cube, vertices);
            found.insert(found.end(), folded.begin(), folded.end());
        }
        return true;
    }

    /// The cubes with quads that have corners in a block.
    std::set<Coord> cubesAbout(const Coord& block) const
    {
        std::set<Coord> cubes;
        for (int step = 0; step < 8; ++step)
            cubes.insert(mGrid.cubeOf(
                block.offsetBy(8 * (step >> 2 & 1), 8 * (step >> 1 & 1), 8 * (step & 1))));
        return cubes;
    }

    const NumberedBlock& blockOf(std::uint32_t v) const
    {
        const auto after = std::upper_bound(mBlocks.begin(), mBlocks.end(), v,
                                            [](std::uint32_t vertex, const NumberedBlock& block) {
                                                return vertex < block.firstVertex;
                                            });
        return *std::prev(after);
    }

    const NumberedBlock* numberedAt(const Coord& origin) const
    {
        const auto found = mIndex.find(origin);
        if (found == mIndex.end()) // a block that its own part does not cross
            throw InputError("a part of a grid is damaged: make it again");
        return found->second;
    }

    const PartedGrid& mGrid;
    std::string mPrefix;
    Interrupter& mProgress;
    Quiet mQuiet;
    ExtractSettings mSettings;
    Coord mFrame;
    std::vector<Coord> mCubes;
    std::vector<NumberedBlock> mBlocks; ///< in the order of their numbers
    std::unordered_map<Coord, const NumberedBlock*> mIndex;
    std::map<std::uint32_t, Freedom> mFreedoms; ///< of vertices that were retracted
    Mesh mMesh;
};

} // namespace

Mesh meshOfParts(const PartedGrid& grid, const std::string& prefix, const ExtractSettings& settings,
                 std::uint64_t maxBytes, Interrupter& progress)
{
    return PartsMesher(grid, prefix, settings, progress).run(maxBytes);
}

} // namespace mpuvdb
