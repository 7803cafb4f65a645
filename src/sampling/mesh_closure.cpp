#include "mesh_closure.h"

#include "core/union_find.h"
#include "spatial/nearest_place.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>
#include <unordered_map>
#include <unordered_set>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using Segment = std::array<Vec3d, 2>;

constexpr int kHalvings = 10; ///< of an edge [derived: to kTouch, a thousandth of a voxel]
/// Distance of a sign's change from a triangle that makes it, voxels. [derived: two last halves]
constexpr double kAtTriangle = 2.0 / (1 << kHalvings);
constexpr std::uint32_t kNone =
    std::numeric_limits<std::uint32_t>::max(); ///< number of no vertex [derived: type's largest]

/// An edge between neighboring voxels.
struct LatticeEdge {
    Coord low;
    int axis;

    Coord high() const
    {
        Coord c = low;
        ++c[axis];
        return c;
    }
    bool operator<(const LatticeEdge& o) const
    {
        return low != o.low ? low < o.low : axis < o.axis;
    }
    bool operator==(const LatticeEdge& o) const { return low == o.low && axis == o.axis; }
};

/// An edge whose ends are on different sides.
struct Crossing {
    LatticeEdge edge;
    Vec3d place;      ///< of the change, voxels
    bool isFree;      ///< away from triangles
    bool lowIsInside; ///< the lower end
};

template <typename T>
void sortUnique(std::vector<T>& values)
{
    tbb::parallel_sort(values.begin(), values.end());
    values.erase(std::unique(values.begin(), values.end()), values.end());
}

/// Follows the surfaces.
class Follower
{
public:
    Follower(const OpenMesh& mesh, const Lattice& lattice, Interrupter& progress)
        : mMesh(mesh), mH(lattice.voxelSize), mShift(lattice.origin - mesh.frame),
          mProgress(progress)
    {
    }

    MeshClosure run(const std::vector<Segment>& starts)
    {
        follow(cellsAround(starts));
        MeshClosure closure;
        addVertices(closure);
        addFacets(closure);
        return closure;
    }

private:
    Vec3d placeOf(const Vec3d& voxels) const { return mH * voxels + mShift; }
    static Vec3d vecOf(const Coord& c) { return Vec3d(c.x(), c.y(), c.z()); }

    /// The winding number beyond one half, at most 0 where nothing is inside.
    double excess(const Vec3d& voxels) const
    {
        const Vec3d place = placeOf(voxels);
        const double excess = mMesh.winding.at(place) - 0.5;
        return mMesh.box.contains(place) ? excess : std::min(excess, 0.0);
    }

    /// The cells that segments pass, and those about them.
    std::vector<Coord> cellsAround(const std::vector<Segment>& segments) const
    {
        std::unordered_set<Coord> passed;
        for (const Segment& segment : segments) {
            mProgress.check();
            const Vec3d from = (segment[0] - mShift) / mH, to = (segment[1] - mShift) / mH;
            const int steps = 1 + int((to - from).norm());
            for (int n = 0; n <= steps; ++n) {
                const Vec3d x = from + double(n) / steps * (to - from);
                passed.insert(Coord::floor(openvdb::Vec3d(x[0], x[1], x[2])));
            }
        }
        std::vector<Coord> around;
        for (const Coord& c : passed)
            for (int n = 0; n < 27; ++n)
                around.push_back(c.offsetBy(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1));
        sortUnique(around);
        return around;
    }

    void follow(std::vector<Coord> cells)
    {
        while (!cells.empty()) {
            measureCorners(cells);
            std::vector<Crossing> found = newCrossings(cells);
            for (const Coord& c : cells) mSeen.emplace(c, kNone);
            std::vector<Coord> next;
            for (const Crossing& crossing : found) {
                mCrossings.emplace(crossing.edge, std::uint32_t(mFound.size()));
                mFound.push_back(crossing);
                if (!crossing.isFree) continue;
                for (const Coord& cell : cellsOf(crossing.edge))
                    if (mSeen.count(cell) == 0) next.push_back(cell);
            }
            sortUnique(next);
            cells = std::move(next);
        }
    }

    void measureCorners(const std::vector<Coord>& cells)
    {
        std::vector<Coord> corners;
        for (const Coord& c : cells)
            for (int n = 0; n < 8; ++n) {
                const Coord corner = c.offsetBy(n >> 2, n >> 1 & 1, n & 1);
                if (mExcess.count(corner) == 0) corners.push_back(corner);
            }
        sortUnique(corners);
        std::vector<float> excess(corners.size());
        forEach(corners.size(),
                [&](std::size_t n) { excess[n] = float(this->excess(vecOf(corners[n]))); });
        for (std::size_t n = 0; n < corners.size(); ++n) mExcess.emplace(corners[n], excess[n]);
    }

    std::vector<Crossing> newCrossings(const std::vector<Coord>& cells) const
    {
        std::vector<LatticeEdge> edges;
        for (const Coord& c : cells)
            forEachEdge(c, [&](const LatticeEdge& edge) {
                const bool low = mExcess.at(edge.low) > 0, high = mExcess.at(edge.high()) > 0;
                if (low != high && mCrossings.count(edge) == 0) edges.push_back(edge);
            });
        sortUnique(edges);
        std::vector<Crossing> crossings(edges.size());
        forEach(edges.size(), [&](std::size_t n) { crossings[n] = crossingOf(edges[n]); });
        return crossings;
    }

    Crossing crossingOf(const LatticeEdge& edge) const
    {
        const double atLow = mExcess.at(edge.low), atHigh = mExcess.at(edge.high());
        const bool lowIsInside = atLow > 0;
        Vec3d low = vecOf(edge.low), high = vecOf(edge.high());
        std::size_t slot = 0;
        if (!mMesh.boundary.isWithin(placeOf((low + high) / 2), (0.5 + kAtTriangle) * mH, slot))
            return {edge, low + atLow / (atLow - atHigh) * (high - low), true, lowIsInside};
        for (int n = 0; n < kHalvings; ++n) {
            const Vec3d middle = (low + high) / 2;
            ((excess(middle) > 0) == lowIsInside ? low : high) = middle;
        }
        const Vec3d place = (low + high) / 2;
        const bool isFree = !mMesh.boundary.isWithin(placeOf(place), kAtTriangle * mH, slot);
        return {edge, place, isFree, lowIsInside};
    }

    /// A vertex for each cell with free crossings: their mean; beside other crossings, the place on
    /// the mesh nearest to it.
    void addVertices(MeshClosure& closure)
    {
        std::vector<Coord> cells;
        for (const Crossing& crossing : mFound)
            if (crossing.isFree)
                for (const Coord& cell : cellsOf(crossing.edge)) cells.push_back(cell);
        sortUnique(cells);
        closure.positions.resize(cells.size());
        std::vector<std::uint8_t> isSeam(cells.size());
        forEach(cells.size(), [&](std::size_t n) {
            Vec3d sum = Vec3d::Zero();
            int count = 0;
            forEachEdge(cells[n], [&](const LatticeEdge& edge) {
                const auto at = mCrossings.find(edge);
                if (at == mCrossings.end()) return;
                const Crossing& crossing = mFound[at->second];
                if (!crossing.isFree) isSeam[n] = 1;
                if (!crossing.isFree) return;
                sum += crossing.place;
                ++count;
            });
            const Vec3d mean = placeOf(sum / count);
            closure.positions[n] = (isSeam[n] ? nearestOnMesh(mean) : mean).cast<float>();
        });
        for (std::uint32_t n = 0; n < cells.size(); ++n) {
            mSeen[cells[n]] = n;
            if (isSeam[n]) closure.seam.push_back(cells[n]);
        }
    }

    /// The nearest place on the boundary, or @a place if that is farther than a voxel.
    Vec3d nearestOnMesh(const Vec3d& place) const
    {
        std::size_t slot = 0;
        if (mMesh.boundary.squaredDistance(place, slot) > mH * mH) return place;
        const TriangleTree::Corners& t = mMesh.boundary.corners(slot);
        return NearestPlace(place, {t[0].cast<double>(), t[1].cast<double>(), t[2].cast<double>()})
            .place;
    }

    /// Two triangles across each free crossing, between the vertices of the four cells about it.
    void addFacets(MeshClosure& closure)
    {
        UnionFind surfaces(closure.positions.size());
        std::vector<std::array<std::uint32_t, 4>> quads;
        for (const Crossing& crossing : sortedFree()) {
            const auto cells = cellsOf(crossing.edge);
            std::array<std::uint32_t, 4> quad;
            for (std::size_t k = 0; k < 4; ++k) quad[k] = mSeen.at(cells[k]);
            if (!crossing.lowIsInside) std::swap(quad[1], quad[3]);
            for (std::size_t k = 1; k < 4; ++k) surfaces.join(quad[0], quad[k]);
            closure.triangles.push_back({quad[0], quad[1], quad[2]});
            closure.triangles.push_back({quad[0], quad[2], quad[3]});
        }
        measureHoles(closure, surfaces);
    }

    std::vector<Crossing> sortedFree() const
    {
        std::vector<Crossing> crossings;
        for (const Crossing& crossing : mFound)
            if (crossing.isFree) crossings.push_back(crossing);
        std::sort(crossings.begin(), crossings.end(),
                  [](const Crossing& a, const Crossing& b) { return a.edge < b.edge; });
        return crossings;
    }

    void measureHoles(MeshClosure& closure, UnionFind& surfaces) const
    {
        std::unordered_map<std::uint32_t, std::size_t> numbers; // of holes, by surface
        for (const Mesh::Triangle& t : closure.triangles) {
            const auto [at, isNew] = numbers.emplace(surfaces.find(t[0]), closure.holes.size());
            if (isNew) closure.holes.emplace_back();
            ClosedHole& hole = closure.holes[at->second];
            std::array<Vec3d, 3> p;
            for (std::size_t k = 0; k < 3; ++k) {
                p[k] = closure.positions[t[k]].cast<double>() + mMesh.frame;
                hole.box.extend(p[k]);
            }
            hole.area += (p[1] - p[0]).cross(p[2] - p[0]).norm() / 2;
        }
    }

    /// The cells about an edge, counter-clockwise seen from its higher end.
    static std::array<Coord, 4> cellsOf(const LatticeEdge& edge)
    {
        const int u = (edge.axis + 1) % 3, v = (edge.axis + 2) % 3;
        std::array<Coord, 4> cells = {edge.low, edge.low, edge.low, edge.low};
        --cells[0][u], --cells[0][v];
        --cells[1][v];
        --cells[3][u];
        return cells;
    }

    /// Call f(edge) for the twelve edges of a cell.
    template <typename F>
    static void forEachEdge(const Coord& cell, const F& f)
    {
        for (int axis = 0; axis < 3; ++axis)
            for (int n = 0; n < 4; ++n) {
                Coord low = cell;
                low[(axis + 1) % 3] += n & 1;
                low[(axis + 2) % 3] += n >> 1;
                f(LatticeEdge{low, axis});
            }
    }

    struct EdgeHash {
        std::size_t operator()(const LatticeEdge& e) const
        {
            return std::hash<Coord>()(e.low) * 3 + std::size_t(e.axis);
        }
    };

    /// Call f(n) for n below @a count, from many threads.
    template <typename F>
    void forEach(std::size_t count, const F& f) const
    {
        /// Numbers between two checks. [derived: 64 winding numbers take a millisecond]
        constexpr std::size_t kTogether = 64;
        tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, kTogether),
                          [&](const auto& range) {
                              mProgress.check();
                              for (std::size_t n = range.begin(); n < range.end(); ++n) f(n);
                          });
    }

    const OpenMesh& mMesh;
    double mH;    ///< voxel size, world units
    Vec3d mShift; ///< of voxel (0,0,0) from the frame
    Interrupter& mProgress;
    std::unordered_map<Coord, float> mExcess;
    std::unordered_map<Coord, std::uint32_t> mSeen; ///< vertices of cells; kNone: none
    std::unordered_map<LatticeEdge, std::uint32_t, EdgeHash> mCrossings;
    std::vector<Crossing> mFound;
};

} // namespace

MeshClosure closeHoles(const OpenMesh& mesh, const Lattice& lattice,
                       const std::vector<std::array<Vec3d, 2>>& starts, Interrupter& progress)
{
    return Follower(mesh, lattice, progress).run(starts);
}

} // namespace mpuvdb
