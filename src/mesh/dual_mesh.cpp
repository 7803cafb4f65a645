#include "dual_mesh.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <fmt/format.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

namespace mpuvdb
{
namespace
{

constexpr std::size_t kGrain = 16; ///< blocks in a task [free: grain size]

using Blocks = tbb::blocked_range<std::size_t>;

struct Corner {
    Vec3f position;
    bool feature;
};

/// The squared quotient of twice a triangle's area and its longest edge's square: a measure of its
/// smallest angle.
float shapeOf(const Vec3f& normal, float edge2, float other2, float third2)
{
    const float longest = std::max({edge2, other2, third2});
    return longest > 0 ? (normal * (1 / longest)).squaredNorm() : 0;
}

/// The shape (see shapeOf) below which triangles are flat. [tuned: sharp_mesh_test]
constexpr float kFlat = 1e-6f;

/// How a quad becomes triangles.
enum class Split : std::uint8_t {
    Even, ///< from corner 0 to 2
    Odd,  ///< from corner 1 to 3
    Flat  ///< either way one would be flat
};

/// The pairs of triangles that a quad can become.
class QuadHalves
{
public:
    explicit QuadHalves(const std::array<Corner, 4>& q)
        : mCorners(q), mAb(q[1].position - q[0].position), mBc(q[2].position - q[1].position),
          mCd(q[3].position - q[2].position), mDa(q[0].position - q[3].position)
    {
    }

    /// The split that makes no flat triangle; along a crease where two opposite corners lie on it;
    /// from the middle one where three do, as they are nearly collinear; else the one that does not
    /// fold over and has the better worst triangle.
    Split split() const
    {
        const bool isEven = prefersEven();
        if ((isEven ? even() : odd()) >= kFlat) return isEven ? Split::Even : Split::Odd;
        if ((isEven ? odd() : even()) >= kFlat) return isEven ? Split::Odd : Split::Even;
        return Split::Flat;
    }

private:
    bool prefersEven() const
    {
        const auto& [a, b, c, d] = mCorners;
        const bool evenCrease = a.feature && c.feature, oddCrease = b.feature && d.feature;
        const bool evenMiddle = oddCrease && (a.feature || c.feature);
        const bool oddMiddle = evenCrease && (b.feature || d.feature);
        if (evenMiddle != oddMiddle) return evenMiddle;
        if (evenCrease != oddCrease) return evenCrease;
        const bool evenFolds = mAb.cross(mBc).dot(mCd.cross(mDa)) < 0;
        const bool oddFolds = mDa.cross(mAb).dot(mBc.cross(mCd)) < 0;
        if (evenFolds != oddFolds) return oddFolds;
        return even() >= odd();
    }

    /// The worse shape of a split from corner 0 to 2.
    float even() const { return worse(mAb, mBc, mCd, mDa); }
    /// The worse shape of a split from corner 1 to 3.
    float odd() const { return worse(mDa, mAb, mBc, mCd); }
    static float worse(const Vec3f& u, const Vec3f& v, const Vec3f& w, const Vec3f& x)
    {
        const float diagonal2 = (u + v).squaredNorm();
        return std::min(shapeOf(u.cross(v), u.squaredNorm(), v.squaredNorm(), diagonal2),
                        shapeOf(w.cross(x), w.squaredNorm(), x.squaredNorm(), diagonal2));
    }

    const std::array<Corner, 4>& mCorners;
    Vec3f mAb, mBc, mCd, mDa;
};

/// The cosine between a triangle's normal and the gradient below which it is folded over in any
/// case. [tuned: sharp_mesh_test]
constexpr float kFolded = -0.2f;

/// Both triangles of a quad.
DualMesh::Halves halvesOf(const DualMesh::Quad& q, bool even)
{
    if (even) return {{{q[0], q[1], q[2]}, {q[0], q[2], q[3]}}};
    return {{{q[0], q[1], q[3]}, {q[1], q[2], q[3]}}};
}

} // namespace

/// The direction in which the surface faces, from the values' gradients.
class Facing
{
public:
    /// @param frame  the voxel that positions count from.
    Facing(const openvdb::FloatTree& tree, const openvdb::Coord& frame, double voxelSize)
        : mAccess(tree), mFrame(frame), mScale(float(1 / (3 * voxelSize)))
    {
    }

    /// The product of a triangle's normal and the gradient at the nearest voxel, both of any
    /// length: below 0 for a triangle that faces against the values.
    float along(const Vec3f& a, const Vec3f& b, const Vec3f& c)
    {
        const Vec3f middle = (a + b + c) * mScale;
        const openvdb::Coord at =
            mFrame + openvdb::Coord::round(openvdb::Vec3d(middle.x(), middle.y(), middle.z()));
        if (at != mAt) {
            mAt = at;
            mGradient = gradientAt(at);
        }
        return (b - a).cross(c - a).dot(mGradient);
    }

    /// The cosine between the two.
    float cosine(const Vec3f& a, const Vec3f& b, const Vec3f& c)
    {
        const float product = along(a, b, c);
        const float length = (b - a).cross(c - a).norm() * mGradient.norm();
        return length > 0 ? product / length : 0;
    }

private:
    Vec3f gradientAt(const openvdb::Coord& at) const
    {
        Vec3f gradient;
        for (int axis = 0; axis < 3; ++axis) {
            openvdb::Coord up = at, down = at;
            ++up[axis];
            --down[axis];
            gradient[axis] = mAccess.getValue(up) - mAccess.getValue(down);
        }
        return gradient;
    }

    /// Not registered with the tree, which does not change meanwhile.
    openvdb::tree::ValueAccessor<const openvdb::FloatTree, false> mAccess;
    openvdb::Coord mFrame;
    float mScale;                               ///< from the sum of three corners to voxels
    openvdb::Coord mAt = openvdb::Coord::max(); ///< the last voxel
    Vec3f mGradient = Vec3f::Zero();            ///< there, of any length
};

DualMesh::DualMesh(const openvdb::FloatTree& tree, const Lattice& lattice,
                   const openvdb::Coord& frame, const ExtractSettings& settings,
                   const BlockFilter& only, Interrupter& progress)
    : mTree(tree), mLattice(lattice), mSettings(settings), mProgress(progress),
      mCells(mTree, lattice.voxelSize, progress, only), mFrame(frame)
{
    if (mCells.vertices() > std::numeric_limits<std::uint32_t>::max())
        throw LimitError(fmt::format("mesh: would have {} vertices, more than 32 bits can number. "
                                     "Use larger voxels, or mesh parts",
                                     mCells.vertices()));
    mMesh.frame = mLattice.origin + mLattice.voxelSize * Vec3d(mFrame.x(), mFrame.y(), mFrame.z());
    mMesh.positions.resize(mCells.vertices());
    // The system clears new memory at its first write: half of it on another thread.
    tbb::parallel_invoke([&] { mMesh.triangles.resize(2 * mCells.quads()); },
                         [&] {
                             mVertices = std::vector<State>(mCells.vertices());
                             mOutwards.resize(mCells.quads());
                         });
}

void DualMesh::placeAll(const Vertices& again)
{
    place(Selection(mCells.blocks().size(), 1));
    if (again.empty()) return;
    ++mRound;
    for (const std::uint32_t v : again) mVertices[v].round = mRound;
}

DualMesh::Vertices DualMesh::split(const Selection& blocks)
{
    return splitEach(blocks, [&](std::size_t n, const auto& make) {
        const std::uint64_t first = mCells.blocks()[n].firstQuad;
        mCells.forEachQuad(n, [&](std::uint64_t quad, const Quad& corners, int outwards) {
            if (!isNew(corners)) return;
            mOutwards[first + quad] = std::uint8_t(outwards);
            make(corners, first + quad);
        });
    });
}

template <typename Work>
void DualMesh::forEachBlock(const Selection& selection, const Work& work)
{
    tbb::parallel_for(Blocks(0, mCells.blocks().size(), kGrain), [&](const Blocks& range) {
        mProgress.check();
        for (std::size_t n = range.begin(); n < range.end(); ++n)
            if (selection[n]) work(n);
    });
}

/// Places the vertices in some blocks that are not placed.
void DualMesh::place(const Selection& selection)
{
    const float h = float(mLattice.voxelSize);
    tbb::enumerable_thread_specific<SheetPlacer> placers(
        [&] { return SheetPlacer(mSettings.field, mLattice); });
    forEachBlock(selection, [&](std::size_t n) {
        SheetPlacer& placer = placers.local();
        const DualBlock& block = mCells.blocks()[n];
        const openvdb::Coord from = block.origin - mFrame;
        const Vec3f origin(float(from.x()), float(from.y()), float(from.z()));
        placer.load(mTree, block.origin);
        block.forEachCell([&](const Vec3i& at, const DualCell& cell) {
            for (int sheet = 0; sheet < cell.sheets().count; ++sheet) {
                const std::uint64_t v = block.firstVertex + cell.vertex + std::uint64_t(sheet);
                State& state = mVertices[v];
                if (state.round == State::kUnplaced) {
                    const SheetVertex vertex = placer.place(at, cell, sheet, state.freedom);
                    mMesh.positions[v] = h * (origin + vertex.position);
                    state.feature = vertex.feature;
                    state.reach = std::uint8_t(std::min(vertex.reach / kReachStep, 255.0f));
                    state.round = mRound;
                }
            }
        });
    });
}

/// As split(), of the quads with a vertex that was placed in this round.
DualMesh::Vertices DualMesh::splitAgain(const Selection& selection)
{
    return splitEach(selection, [&](std::size_t n, const auto& make) {
        const DualBlock& block = mCells.blocks()[n];
        for (std::uint64_t q = block.firstQuad; q < block.firstQuad + block.quads; ++q) {
            const Quad corners = cornersOf(q);
            if (isNew(corners)) make(corners, q);
        }
    });
}

/// @param visit  called with each block of @a selection and a function that makes a quad's
/// triangles.
template <typename Visit>
DualMesh::Vertices DualMesh::splitEach(const Selection& selection, const Visit& visit)
{
    std::vector<Vertices> folded(selection.size());
    forEachBlock(selection, [&](std::size_t n) {
        Facing facing(mTree, mFrame, mLattice.voxelSize);
        visit(n, [&](const Quad& corners, std::uint64_t number) {
            if (splitOne(corners, number)) findTouching(corners, folded[n]);
            if (isNearCrease(corners)) findFolded(number, corners, facing, folded[n]);
        });
    });
    Vertices all;
    for (const Vertices& some : folded) all.insert(all.end(), some.begin(), some.end());
    return all;
}

/// @return whether one of the triangles is flat in any case.
bool DualMesh::splitOne(const Quad& q, std::uint64_t number)
{
    std::array<Corner, 4> corners;
    for (std::size_t c = 0; c < 4; ++c)
        corners[c] = {mMesh.positions[q[c]], mVertices[q[c]].feature};
    const Split how = QuadHalves(corners).split();
    setTriangles(number, halvesOf(q, how != Split::Odd));
    return how == Split::Flat;
}

void DualMesh::setTriangles(std::uint64_t quad, const Halves& halves)
{
    std::copy(halves.begin(), halves.end(), mMesh.triangles.begin() + std::ptrdiff_t(2 * quad));
}

bool DualMesh::isSplitEven(std::uint64_t quad) const
{
    return mMesh.triangles[2 * quad][2] == mMesh.triangles[2 * quad + 1][1];
}

DualMesh::Quad DualMesh::cornersOf(std::uint64_t quad) const
{
    const Mesh::Triangle &a = mMesh.triangles[2 * quad], &b = mMesh.triangles[2 * quad + 1];
    return isSplitEven(quad) ? Quad{a[0], a[1], a[2], b[2]} : Quad{a[0], a[1], b[1], a[2]};
}

/// Whether a vertex of the quad was placed in this round.
bool DualMesh::isNew(const Quad& corners) const
{
    return std::any_of(corners.begin(), corners.end(),
                       [&](std::uint32_t v) { return mVertices[v].round == mRound; });
}

bool DualMesh::retract(Vertices& found)
{
    std::sort(found.begin(), found.end());
    found.erase(std::unique(found.begin(), found.end()), found.end());
    Selection changed(mCells.blocks().size(), 0);
    bool isRetracted = false;
    for (const std::uint32_t v : found) {
        Freedom& freedom = mVertices[v].freedom;
        if (freedom == Freedom::None) continue;
        freedom = Freedom(int(freedom) + 1);
        mVertices[v].round = State::kUnplaced;
        changed[mCells.blockOf(v)] = 1;
        isRetracted = true;
    }
    if (!isRetracted) return false;
    ++mRound;
    place(changed);
    found = splitAgain(mCells.withNeighbors(changed));
    return true;
}

/// Whether a corner lies on a crease, or was retracted from one.
bool DualMesh::isNearCrease(const Quad& corners) const
{
    return std::any_of(corners.begin(), corners.end(), [&](std::uint32_t v) {
        return mVertices[v].feature || mVertices[v].freedom != Freedom::Near;
    });
}

/// Splits the quad the other way where one of its triangles faces against the values and no
/// triangle of the other way does; adds the vertices of those that still fold over.
void DualMesh::findFolded(std::uint64_t quad, const Quad& corners, Facing& facing, Vertices& found)
{
    const auto corner = [&](std::uint32_t v) -> const Vec3f& { return mMesh.positions[v]; };
    const auto along = [&](const Mesh::Triangle& v) {
        return facing.along(corner(v[0]), corner(v[1]), corner(v[2]));
    };
    const bool even = isSplitEven(quad);
    const Halves halves = halvesOf(corners, even);
    if (along(halves[0]) >= 0 && along(halves[1]) >= 0) return;
    const Halves others = halvesOf(corners, !even);
    if (along(others[0]) > 0 && along(others[1]) > 0) {
        setTriangles(quad, others);
        return;
    }
    for (const Mesh::Triangle& v : halves) {
        const float cosine = facing.cosine(corner(v[0]), corner(v[1]), corner(v[2]));
        if (isFolded(v, cosine, mOutwards[quad])) found.insert(found.end(), v.begin(), v.end());
    }
}

/// Adds one of the two vertices nearest to each other: the one farther from its cell. Where an
/// edge crosses the surface on a crease, the cells on both sides find the same place, and that
/// vertex's cell holds less of the crease; at a voxel on the surface, all cells about it may.
void DualMesh::findTouching(const Quad& corners, Vertices& found) const
{
    const auto way = [&](std::uint32_t v) {
        const State& state = mVertices[v];
        return std::make_tuple(state.freedom != Freedom::None, state.reach, v);
    };
    float nearest = std::numeric_limits<float>::max();
    std::uint32_t farther = corners[0];
    for (std::size_t n = 1; n < 4; ++n)
        for (std::size_t m = 0; m < n; ++m) {
            const std::uint32_t v = corners[n], w = corners[m];
            const float apart = (mMesh.positions[v] - mMesh.positions[w]).squaredNorm();
            if (apart >= nearest) continue;
            nearest = apart;
            farther = way(v) > way(w) ? v : w;
        }
    found.push_back(farther);
}

/// Whether a triangle is folded over: it faces against the values, with a cosine of @a facing
/// either below kFolded (beside sharp edges it may be slightly negative) or also against the
/// edge that its quad belongs to.
bool DualMesh::isFolded(const Mesh::Triangle& v, float facing, int outwards) const
{
    const Vec3f &a = mMesh.positions[v[0]], &b = mMesh.positions[v[1]], &c = mMesh.positions[v[2]];
    const float along = (b - a).cross(c - a)[outwards % 3];
    return facing < kFolded || (facing < 0 && (outwards < 3 ? along : -along) < 0);
}

DualMesh::Vertices crossingVertices(const Mesh& mesh, Interrupter& progress)
{
    DualMesh::Vertices found;
    for (const TrianglePair& pair : findSelfIntersections(mesh, &progress))
        for (const std::uint32_t t : pair)
            found.insert(found.end(), mesh.triangles[t].begin(), mesh.triangles[t].end());
    return found;
}

} // namespace mpuvdb
