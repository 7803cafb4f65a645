#include "sheet_vertex.h"

#include <mpuvdb/error.h>
#include <mpuvdb/mesh.h>
#include <mpuvdb/progress.h>

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <cmath>
#include <limits>

namespace mpuvdb
{
namespace
{

constexpr std::size_t kGrain = 16; // blocks

using Blocks = tbb::blocked_range<std::size_t>;

struct Corner {
    Vec3f position;
    bool feature;
};

/// How small the smallest angle of a triangle is: twice its area by the square of its longest edge.
float shapeOf(const Vec3f& a, const Vec3f& b, const Vec3f& c)
{
    const float longest =
        std::max({(b - a).squaredNorm(), (c - b).squaredNorm(), (a - c).squaredNorm()});
    return longest > 0 ? (b - a).cross(c - a).norm() / longest : 0;
}

/// Whether to split from corner 0 to 2, and not from 1 to 3: along a crease where there is one, and
/// else so that the worse triangle is the better. A split that folds the quad over loses.
bool splitsEven(const std::array<Corner, 4>& q)
{
    const auto& [a, b, c, d] = q;
    const Vec3f abc = (b.position - a.position).cross(c.position - a.position);
    const Vec3f acd = (c.position - a.position).cross(d.position - a.position);
    const Vec3f abd = (b.position - a.position).cross(d.position - a.position);
    const Vec3f bcd = (c.position - b.position).cross(d.position - b.position);
    const bool evenFolds = abc.dot(acd) < 0, oddFolds = abd.dot(bcd) < 0;
    if (evenFolds != oddFolds) return oddFolds;
    const bool evenCrease = a.feature && c.feature, oddCrease = b.feature && d.feature;
    if (evenCrease != oddCrease) return evenCrease;
    const float even = std::min(shapeOf(a.position, b.position, c.position),
                                shapeOf(a.position, c.position, d.position));
    const float odd = std::min(shapeOf(a.position, b.position, d.position),
                               shapeOf(b.position, c.position, d.position));
    return even >= odd;
}

class Extraction
{
public:
    Extraction(const LevelSet& levelSet, const Field* field, Progress& progress)
        : mTree(levelSet.grid().tree()), mLattice(levelSet.lattice()), mField(field),
          mProgress(progress), mCells(mTree, progress)
    {
    }

    Mesh run()
    {
        mProgress.advance();
        if (mCells.vertices() > std::numeric_limits<std::uint32_t>::max())
            throw LimitError(fmt::format("mesh: would have {} vertices, more than 32 bits can "
                                         "number. Use larger voxels, or mesh parts",
                                         mCells.vertices()));
        openvdb::CoordBBox box;
        mTree.evalLeafBoundingBox(box);
        mFrame = box.empty() ? openvdb::Coord(0) : openvdb::Coord::round(box.getCenter());
        mMesh.frame =
            mLattice.origin + mLattice.voxelSize * Vec3d(mFrame.x(), mFrame.y(), mFrame.z());
        mMesh.positions.resize(mCells.vertices());
        mFeature.resize(mCells.vertices());
        mMesh.triangles.resize(2 * mCells.quads());
        placeAll();
        mProgress.advance();
        splitAll();
        mProgress.advance();
        return std::move(mMesh);
    }

private:
    template <typename Work>
    void forEachBlock(const Work& work)
    {
        tbb::parallel_for(Blocks(0, mCells.blocks().size(), kGrain), [&](const Blocks& range) {
            mProgress.check();
            work(range);
        });
    }

    void placeAll()
    {
        const float h = float(mLattice.voxelSize);
        forEachBlock([&](const Blocks& range) {
            SheetPlacer placer(mField, mLattice);
            for (std::size_t n = range.begin(); n < range.end(); ++n) {
                const DualBlock& block = mCells.blocks()[n];
                const openvdb::Coord from = block.origin - mFrame;
                const Vec3f origin(float(from.x()), float(from.y()), float(from.z()));
                placer.load(mTree, block.origin);
                block.forEachCell([&](const Vec3i& at, const DualCell& cell) {
                    for (int sheet = 0; sheet < cell.sheets().count; ++sheet) {
                        const SheetVertex vertex = placer.place(at, cell, sheet);
                        const std::uint64_t v =
                            block.firstVertex + cell.vertex + std::uint64_t(sheet);
                        mMesh.positions[v] = h * (origin + vertex.position);
                        mFeature[v] = vertex.feature;
                    }
                });
            }
        });
    }

    void splitAll()
    {
        forEachBlock([&](const Blocks& range) {
            for (std::size_t n = range.begin(); n < range.end(); ++n) {
                const std::uint64_t first = mCells.blocks()[n].firstQuad;
                mCells.forEachQuad(
                    n, [&](std::uint64_t quad, const std::array<std::uint32_t, 4>& q) {
                        Mesh::Triangle* const out = &mMesh.triangles[2 * (first + quad)];
                        std::array<Corner, 4> corners;
                        for (std::size_t c = 0; c < 4; ++c)
                            corners[c] = {mMesh.positions[q[c]], mFeature[q[c]] != 0};
                        const bool even = splitsEven(corners);
                        out[0] = even ? Mesh::Triangle{q[0], q[1], q[2]}
                                      : Mesh::Triangle{q[0], q[1], q[3]};
                        out[1] = even ? Mesh::Triangle{q[0], q[2], q[3]}
                                      : Mesh::Triangle{q[1], q[2], q[3]};
                    });
            }
        });
    }

    const openvdb::FloatTree& mTree;
    Lattice mLattice;
    const Field* mField;
    Progress& mProgress;
    DualCells mCells;
    openvdb::Coord mFrame;
    Mesh mMesh;
    std::vector<char> mFeature;
};

} // namespace

Mesh extractMesh(const LevelSet& levelSet, Progress& progress, const Field* field)
{
    progress.beginStage("mesh", 3);
    Mesh mesh = Extraction(levelSet, field, progress).run();
    progress.endStage();
    return mesh;
}

} // namespace mpuvdb
