// The zero set of a level set, or of a part of one, as triangles: vertices of dual contouring, and
// how those of triangles that fold over are retracted.
#pragma once
#include "surface/sheet_vertex.h"
#include <mpuvdb/mesh.h>

#include <cstdint>
#include <limits>
#include <vector>

namespace mpuvdb
{

class Facing;
class Interrupter;

/// The voxel from which the positions of a mesh count. @param leaves  the box of the leaves.
inline openvdb::Coord meshFrame(const openvdb::CoordBBox& leaves)
{
    return leaves.empty() ? openvdb::Coord(0) : openvdb::Coord::round(leaves.getCenter());
}

/// Triangles and how they came about. What becomes of a quad is decided by its own vertices and the
/// values about it; what becomes of a vertex, by its cell and by how often it was retracted. So a
/// part of the cells gives that part of the mesh of all, if the retractions of all are made in the
/// same rounds.
class DualMesh
{
public:
    using Vertices = std::vector<std::uint32_t>;
    /// A flag for each block.
    using Selection = std::vector<char>;
    using Quad = std::array<std::uint32_t, 4>;
    /// Both triangles of a quad.
    using Halves = std::array<Mesh::Triangle, 2>;

    /// @param frame  voxel that positions count from. @param only  the blocks of the part, or null;
    /// the tree has the values two voxels below and three above them.
    /// @throws LimitError beyond 2^32 vertices, Interrupted.
    DualMesh(const openvdb::FloatTree& tree, const Lattice& lattice, const openvdb::Coord& frame,
             const ExtractSettings& settings, const BlockFilter& only, Interrupter& progress);

    const DualCells& cells() const { return mCells; }
    /// With positions and triangles, once they are made.
    const Mesh& mesh() const { return mMesh; }
    Mesh take() { return std::move(mMesh); }

    /// How free vertex @a v is, before it is placed.
    void setFreedom(std::uint32_t v, Freedom freedom) { mVertices[v].freedom = freedom; }
    /// Places all vertices. @param again  those that count as new in split() and forEachNewQuad();
    /// none: all do.
    void placeAll(const Vertices& again);
    /// Makes the triangles of the quads of some blocks that have a new vertex.
    /// @return the vertices of those near creases that fold over, and of flat ones.
    Vertices split(const Selection& blocks);
    /// Retracts vertices into their cells, and those retracted before to the middle of their
    /// crossings, and makes their triangles anew.
    /// @param found  the vertices; on return those of the new triangles that fold over.
    /// @return whether any could still be retracted.
    bool retract(Vertices& found);
    /// Calls visit(quad) for each quad of block @a n that has a new vertex.
    template <typename Visit>
    void forEachNewQuad(std::size_t n, const Visit& visit) const
    {
        const DualBlock& block = mCells.blocks()[n];
        mCells.forEachQuad(n, [&](std::uint64_t quad, const Quad& corners, int) {
            if (isNew(corners)) visit(block.firstQuad + quad);
        });
    }

private:
    struct State {
        static constexpr std::uint32_t kUnplaced = ~std::uint32_t(0); ///< [derived: the largest]
        std::uint32_t round = kUnplaced; ///< of retraction, in which it was placed
        Freedom freedom = Freedom::Near;
        bool feature = false;
        std::uint8_t reach = 0; ///< of SheetVertex, in steps of kReachStep
    };
    /// The step of a vertex's reach, voxels. [derived: a byte holds two voxels, more than it goes]
    static constexpr float kReachStep = 1.0f / 128;

    template <typename Work>
    void forEachBlock(const Selection& selection, const Work& work);
    void place(const Selection& selection);
    Vertices splitAgain(const Selection& selection);
    template <typename Visit>
    Vertices splitEach(const Selection& selection, const Visit& visit);
    bool splitOne(const Quad& q, std::uint64_t number);
    void setTriangles(std::uint64_t quad, const Halves& halves);
    bool isSplitEven(std::uint64_t quad) const;
    Quad cornersOf(std::uint64_t quad) const;
    bool isNew(const Quad& corners) const;
    bool isNearCrease(const Quad& corners) const;
    void findFolded(std::uint64_t quad, const Quad& corners, Facing& facing, Vertices& found);
    void findTouching(const Quad& corners, Vertices& found) const;
    bool isFolded(const Mesh::Triangle& v, float facing, int outwards) const;

    const openvdb::FloatTree& mTree;
    Lattice mLattice;
    ExtractSettings mSettings;
    Interrupter& mProgress;
    DualCells mCells;
    openvdb::Coord mFrame;
    Mesh mMesh;
    std::vector<State> mVertices;
    std::uint32_t mRound = 0;            ///< of retraction
    std::vector<std::uint8_t> mOutwards; ///< of each quad, see DualCells::forEachQuad()
};

/// The vertices of the triangles of @a mesh that cross.
DualMesh::Vertices crossingVertices(const Mesh& mesh, Interrupter& progress);

} // namespace mpuvdb
