// Dual contouring [Ju02] of the cells beside creases: each sheet of a cell gets a vertex at the
// place nearest to the planes of the faces that cross its edges, and each crossed edge a facet
// between the vertices of the four cells about it. Where two faces meet in a sheet its vertex lies
// on their crease, where three meet at their corner.
#include "crease_facets.h"

#include "face_crossings.h"
#include "face_patches.h"
#include "leaf_crossings.h"
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <limits>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using Facet = std::array<std::uint32_t, 4>; ///< numbers of vertices, in a row

/// Smallest eigenvalue of the sum of n n^T, relative to the largest, whose direction the planes
/// determine. [tuned: offset_bench]
constexpr float kMinSpread = 0.01f;
/// Largest distance of a vertex from its cell, voxels: the tip of an edge crosses no edge between
/// voxels. [tuned: offset_bench]
constexpr float kMaxOutside = 3;
constexpr float kFacetAllowance = 0.1f; ///< reduction of EmptyBalls, voxels [tuned: offset_bench]
/// Items between two looks at the interrupter. [free: response time]
constexpr std::size_t kCheckInterval = 1 << 12;

/// Corner n of a cell: bits 4, 2, 1 are x, y, z.
Coord cornerOf(int n)
{
    return {n >> 2 & 1, n >> 1 & 1, n & 1};
}

Coord unit(int axis)
{
    return {axis == 0, axis == 1, axis == 2};
}

/// The cells about an edge, in cyclic order.
std::array<Coord, 4> cellsAbout(const Coord& voxel, int axis)
{
    const Coord u = unit((axis + 1) % 3), v = unit((axis + 2) % 3);
    return {voxel, voxel - u, voxel - u - v, voxel - v};
}

/// The number of an edge along @a axis in cell n of cellsAbout(), as in cellEdge().
int edgeOf(std::size_t n, int axis)
{
    return 4 * axis + std::array<int, 4>{0, 2, 3, 1}[n];
}

template <typename F>
void inParallel(std::size_t count, Interrupter& progress, F f)
{
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, 64),
                      [&](const tbb::blocked_range<std::size_t>& range) {
                          progress.check();
                          f(range.begin(), range.end());
                      });
}

class FacetMaker
{
public:
    FacetMaker(SurfacePatches& patches, const CreaseZone& zone, Interrupter& progress)
        : mPatches(patches), mZone(zone), mProgress(progress)
    {
    }

    void run()
    {
        collectCells();
        collectCrossings();
        placeVertices();
        makeFacets();
        makeFans();
    }

private:
    /// Collect the cells about crossed edges at voxels beside creases; the patches of those voxels
    /// are superseded.
    void collectCells()
    {
        const CreaseValues values(mZone);
        mPatches.superseded.assign(mPatches.patches.size(), false);
        for (std::uint32_t n = 0; n < mPatches.patches.size(); ++n) {
            if (n % kCheckInterval == 0) mProgress.check();
            if (!mZone.isBeside(n)) continue;
            const Coord voxel = mPatches.patches[n].voxel;
            for (int axis = 0; axis < 3; ++axis)
                for (const Coord& first : {voxel, voxel - unit(axis)}) {
                    if (!values.crosses(first, first + unit(axis))) continue;
                    mPatches.superseded[n] = true;
                    for (const Coord& cell : cellsAbout(first, axis)) mCells.add(cell);
                }
        }
        mCells.number();
        supersedeZeros();
        mCellAt = mCells.voxels();
        collectSheets();
    }

    /// Find the sheets of the cells.
    void collectSheets()
    {
        mSheets.resize(mCellAt.size());
        inParallel(mCellAt.size(), mProgress, [&](std::size_t n, std::size_t end) {
            const CreaseValues values(mZone);
            for (; n < end; ++n) mSheets[n] = &values.sheetsOf(mCellAt[n]);
        });
        std::uint64_t count = 0;
        mFirstVertex.reserve(mCellAt.size() + 1);
        for (const CellSheets* const sheets : mSheets) {
            mFirstVertex.push_back(std::uint32_t(count));
            count += sheets->count;
            requireIndexable(count + mPatches.patches.size());
        }
        mFirstVertex.push_back(std::uint32_t(count));
    }

    /// Supersede the patches of voxels of value 0 at creases: no edge may cross the surface there,
    /// and such a patch extends beyond the crease.
    void supersedeZeros()
    {
        VoxelNumbers cells(mCells);
        for (std::uint32_t n = 0; n < mPatches.patches.size(); ++n) {
            if (n % kCheckInterval == 0) mProgress.check();
            if (!mZone.isBeside(n) || mPatches.superseded[n]) continue;
            for (int corner = 0; corner < 8 && !mPatches.superseded[n]; ++corner)
                mPatches.superseded[n] =
                    cells[mPatches.patches[n].voxel - cornerOf(corner)] != VoxelIndex::kNone;
        }
    }

    /// Find where the surface crosses the edges of the cells.
    void collectCrossings()
    {
        const CreaseValues values(mZone);
        for (std::size_t n = 0; n < mCellAt.size(); ++n) {
            if (n % kCheckInterval == 0) mProgress.check();
            for (int edge = 0; edge < 12; ++edge) {
                const CellEdge ends = cellEdge(edge);
                if (values.crosses(mCellAt[n] + cornerOf(ends.low),
                                   mCellAt[n] + cornerOf(ends.high)))
                    mEdges[std::size_t(edge / 4)].add(mCellAt[n] + cornerOf(ends.low));
            }
        }
        for (int axis = 0; axis < 3; ++axis) {
            mEdges[axis].number();
            mEdgeAt[axis] = mEdges[axis].voxels();
            mCrossings[axis].resize(mEdgeAt[axis].size());
            inParallel(mEdgeAt[axis].size(), mProgress, [&](std::size_t n, std::size_t end) {
                FaceCrossings crossings(mZone);
                for (; n < end; ++n) mCrossings[axis][n] = crossings.find(mEdgeAt[axis][n], axis);
            });
        }
    }

    void placeVertices()
    {
        const std::uint32_t first = mPatches.voxelPatches();
        mPatches.patches.resize(first + mFirstVertex.back());
        inParallel(mCellAt.size(), mProgress, [&](std::size_t n, std::size_t end) {
            std::array<VoxelNumbers, 3> edges{VoxelNumbers(mEdges[0]), VoxelNumbers(mEdges[1]),
                                              VoxelNumbers(mEdges[2])};
            const CreaseValues values(mZone);
            for (; n < end; ++n)
                for (std::size_t sheet = 0; sheet < mSheets[n]->count; ++sheet)
                    mPatches.patches[first + mFirstVertex[n] + sheet] = SurfacePatch::point(
                        mCellAt[n], vertexOf(mCellAt[n], mSheets[n]->edges[sheet], edges, values));
        });
    }

    /// The place in a cell that is nearest to the planes of the faces which cross a sheet's
    /// @a crossed edges, given by bits.
    Vec3f vertexOf(const Coord& cell, unsigned crossed, std::array<VoxelNumbers, 3>& edges,
                   const CreaseValues& values) const
    {
        std::array<FaceCrossing, 12> found;
        int count = 0;
        Vec3f mean = Vec3f::Zero();
        for (; crossed; crossed &= crossed - 1) {
            const int edge = __builtin_ctz(crossed);
            const Coord low = cornerOf(cellEdge(edge).low);
            const auto axis = std::size_t(edge / 4);
            FaceCrossing& crossing = found[std::size_t(count++)];
            crossing = mCrossings[axis][edges[axis][cell + low]];
            crossing.point += toVec(low);
            mean += crossing.point;
        }
        mean /= float(count);
        Eigen::Matrix3f spread = Eigen::Matrix3f::Zero();
        Vec3f pull = Vec3f::Zero();
        for (int n = 0; n < count; ++n) {
            const FaceCrossing& c = found[std::size_t(n)];
            spread += c.normal * c.normal.transpose();
            pull += c.normal * c.normal.dot(c.point - mean);
        }
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix3f> solver;
        solver.computeDirect(spread); // ascending
        const Vec3f size = solver.eigenvalues();
        std::array<Vec3f, 4> places; // by the number of directions that the planes decide
        places[0] = mean;
        int rank = 0;
        for (; rank < 3 && size[2 - rank] > kMinSpread * std::max(size[2], 0.1f); ++rank) {
            const Vec3f direction = solver.eigenvectors().col(2 - rank);
            places[std::size_t(rank) + 1] =
                places[std::size_t(rank)] + direction * (direction.dot(pull) / size[2 - rank]);
        }
        while (rank > 0 && !isAllowed(cell, places[std::size_t(rank)], values)) --rank;
        return places[std::size_t(rank)];
    }

    /// Whether the surface may pass a place, by the values at the corners of the vertex's cell and
    /// of the cell that holds the place.
    static bool isAllowed(const Coord& cell, const Vec3f& place, const CreaseValues& values)
    {
        const Vec3f middle = Vec3f::Constant(0.5f);
        if (!((place - middle).cwiseAbs().maxCoeff() <= 0.5f + kMaxOutside)) return false;
        const Vec3f low = place.array().floor();
        const Coord other(int(low.x()), int(low.y()), int(low.z()));
        std::array<Coord, 16> corners;
        const std::size_t count = other == Coord(0, 0, 0) ? 8 : 16;
        float slope = 0;
        for (std::size_t n = 0; n < count; ++n) {
            corners[n] = cornerOf(int(n) & 7) + (n < 8 ? Coord(0, 0, 0) : other);
            slope = std::max(slope, values.slopeAt(cell + corners[n]));
        }
        EmptyBalls empty(slope, kFacetAllowance);
        for (std::size_t n = 0; n < count; ++n) empty.add(corners[n], values.at(cell + corners[n]));
        return !empty.contain(place);
    }

    /// Make a facet for each crossed edge whose four cells have vertices.
    void makeFacets()
    {
        VoxelNumbers cells(mCells);
        for (int axis = 0; axis < 3; ++axis)
            for (std::size_t n = 0; n < mEdgeAt[axis].size(); ++n) {
                if (n % kCheckInterval == 0) mProgress.check();
                Facet facet;
                const auto about = cellsAbout(mEdgeAt[axis][n], axis);
                for (std::size_t c = 0; c < 4; ++c)
                    facet[c] = vertexAt(cells[about[c]], edgeOf(c, axis));
                if (std::find(facet.begin(), facet.end(), VoxelIndex::kNone) == facet.end())
                    mFacets.push_back(facet);
            }
        mPatches.facets.resize(mFacets.size());
        inParallel(mFacets.size(), mProgress, [&](std::size_t n, std::size_t end) {
            for (; n < end; ++n) mPatches.facets[n] = facetOf(mFacets[n]);
        });
    }

    /// The vertex of the sheet of a cell, by number, that crosses an edge of it.
    std::uint32_t vertexAt(std::uint32_t cell, int edge) const
    {
        if (cell == VoxelIndex::kNone) return cell;
        return mFirstVertex[cell] + mSheets[cell]->sheet[std::size_t(edge)];
    }

    SurfaceFacet facetOf(const Facet& vertices) const
    {
        const SurfacePatch* const vertex = &mPatches.patches[mPatches.voxelPatches()];
        SurfaceFacet facet;
        facet.voxel = vertex[vertices[0]].voxel;
        for (std::size_t c = 0; c < 4; ++c) facet.corners[c] = -vertex[vertices[c]].to(facet.voxel);
        auto& p = facet.corners;
        if ((p[0] - p[2]).squaredNorm() > (p[1] - p[3]).squaredNorm())
            std::rotate(p.begin(), p.begin() + 1, p.end());
        facet.radius = 0;
        for (const Vec3f& corner : p)
            facet.radius = std::max(facet.radius, (corner - facet.middle()).norm());
        return facet;
    }

    void makeFans()
    {
        auto& end = mPatches.fanEnd;
        end.assign(mFirstVertex.back() + std::size_t(1), 0);
        for (const Facet& facet : mFacets)
            for (const std::uint32_t vertex : facet) ++end[vertex + 1];
        for (std::size_t n = 1; n < end.size(); ++n) end[n] += end[n - 1];
        mPatches.fans.resize(end.back());
        for (std::uint32_t n = 0; n < mFacets.size(); ++n)
            for (const std::uint32_t vertex : mFacets[n]) mPatches.fans[end[vertex]++] = n;
        end.pop_back(); // each entry is now the end of its fan
    }

    SurfacePatches& mPatches;
    const CreaseZone& mZone;
    Interrupter& mProgress;
    VoxelIndex mCells; ///< by their lowest corner
    std::vector<Coord> mCellAt;
    std::vector<const CellSheets*> mSheets;  ///< by cell
    std::vector<std::uint32_t> mFirstVertex; ///< by cell, and the number of all
    std::array<VoxelIndex, 3> mEdges;        ///< crossed, by axis and first voxel
    std::array<std::vector<Coord>, 3> mEdgeAt;
    std::array<std::vector<FaceCrossing>, 3> mCrossings;
    std::vector<Facet> mFacets;
};

} // namespace

void addCreaseFacets(SurfacePatches& patches, CreaseZone& zone, Interrupter& progress)
{
    fitToFaces(patches, zone, progress);
    FacetMaker(patches, zone, progress).run();
}

} // namespace mpuvdb
