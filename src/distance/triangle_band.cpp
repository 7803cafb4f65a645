#include "triangle_band.h"

#include "spatial/nearest_place.h"
#include "spatial/point_triangle.h"
#include <mpuvdb/field.h>
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/task_group.h>

namespace mpuvdb
{
namespace
{

using Leaf = openvdb::FloatTree::LeafNodeType;
using Leaves = std::vector<std::unique_ptr<Leaf>>;
using openvdb::Coord;

Vec3d vecOf(const Coord& at)
{
    return Vec3d(at.x(), at.y(), at.z());
}

/// A cube of voxels, 2^n along each side.
struct Cube {
    Coord first;
    int size;

    Vec3d center() const { return vecOf(first) + Vec3d::Constant(0.5 * (size - 1)); }
    /// Radius of a ball that holds its voxels.
    double radius() const { return std::sqrt(3.0) / 2 * (size - 1); }
    Cube child(int octant) const
    {
        const int half = size / 2;
        return {first + Coord(octant & 1 ? half : 0, octant & 2 ? half : 0, octant & 4 ? half : 0),
                half};
    }
};

/// Largest difference of distances that count as equal, voxels: where triangles were cut, their
/// corners are rounded to floats independently.
double tieFor(const PlacedTriangles& triangles)
{
    /// Smallest tie, voxels. [derived: roundings of doubles at 2^23 voxels, thousandfold]
    constexpr double kMinTie = 1e-6;
    /// Roundings of floats. [derived: two corners along the axes, two distances]
    constexpr double kTieRoundings = 4;
    const TriangleTree::Box& box = triangles.tree.box();
    const float largest = box.min().cwiseAbs().cwiseMax(box.max().cwiseAbs()).maxCoeff();
    return kMinTie + kTieRoundings * double(std::numeric_limits<float>::epsilon() * largest) /
                         triangles.voxelSize;
}

/// Measures the voxels of one leaf after the other by halving cubes, each with the triangles that
/// may be nearest to one of its voxels. For one thread.
class LeafMeasure
{
public:
    /// @param reach  voxels.
    LeafMeasure(const PlacedTriangles& triangles, double reach)
        : mTriangles(triangles), mReach(reach), mTie(tieFor(triangles))
    {
    }

    /// @param distance  voxels from the cube's center to the mesh. Null if nothing is within reach.
    std::unique_ptr<Leaf> measure(const Cube& cube, double distance)
    {
        mCandidates.clear();
        mKept[0].clear();
        const double farthest = bound(distance, cube.radius());
        const TriangleTree& tree = mTriangles.tree;
        tree.forEachNear(mTriangles.place(cube.center()), farthest * mTriangles.voxelSize,
                         [&](std::size_t slot) {
                             mKept[0].push_back(std::uint32_t(mCandidates.size()));
                             mCandidates.push_back(candidateOf(tree.corners(slot)));
                         });
        mLeaf = std::make_unique<Leaf>(cube.first, float(mReach * mTriangles.voxelSize), false);
        refine(cube, 0, distance);
        return mLeaf->isEmpty() ? nullptr : std::move(mLeaf);
    }

private:
    /// A triangle in voxels, and a ball that holds it.
    struct Candidate {
        std::array<Vec3d, 3> corners;
        Vec3d normal; ///< of length 1, or 0
        Vec3d middle;
        double radius;
    };

    Candidate candidateOf(const TriangleTree::Corners& corners) const
    {
        Candidate t;
        for (std::size_t k = 0; k < 3; ++k) t.corners[k] = mTriangles.voxels(corners[k]);
        const auto& [a, b, c] = t.corners;
        t.normal = (b - a).cross(c - a).normalized();
        t.middle = (t.corners[0] + t.corners[1] + t.corners[2]) / 3;
        double square = 0;
        for (const Vec3d& corner : t.corners)
            square = std::max(square, (corner - t.middle).squaredNorm());
        t.radius = std::sqrt(square);
        return t;
    }

    /// Upper bound of the distance from the center of a ball to the nearest triangles of places in
    /// it that are within reach. @param least  upper bound of the smallest distance to the center.
    double bound(double least, double radius) const
    {
        return std::min(least + 2 * radius, mReach + radius) + mTie;
    }

    /// @param atMost  upper bound of the distance from the center to the nearest triangle, voxels.
    void refine(const Cube& cube, std::size_t depth, double atMost)
    {
        constexpr double kRoundings =
            1 + 1e-9; ///< factor [derived: a million roundings of doubles]
        const Vec3d center = cube.center();
        const double radius = cube.radius();
        std::vector<std::uint32_t>& kept = mKept[depth + 1];
        kept.clear();
        mDistances.clear();
        double least = kRoundings * atMost;
        for (const std::uint32_t n : mKept[depth]) {
            const Candidate& t = mCandidates[n];
            const double farthest = bound(least, radius), allowed = farthest + t.radius;
            if ((center - t.middle).squaredNorm() > allowed * allowed) continue;
            const double distance = std::sqrt(squaredDistance(center, t.corners));
            if (distance > farthest) continue;
            kept.push_back(n);
            mDistances.push_back(distance);
            if (distance >= least) continue;
            least = distance;
            // The nearest comes first, which narrows the search of the cubes within this one.
            std::swap(kept.front(), kept.back());
            std::swap(mDistances.front(), mDistances.back());
        }
        if (kept.empty()) return;
        keepUpTo(bound(least, radius), kept);
        if (cube.size == 1) {
            if (!(least < mReach - mTie)) return; // at its end, which rounding may move
            const auto value = float(least * mTriangles.voxelSize);
            // On the surface the side is a matter of rounding: a voxel alone is no part.
            const bool isInside = least > mTie && isBehind(kept, center);
            mLeaf->setValueOn(cube.first, isInside ? -value : value);
            return;
        }
        const double step = std::sqrt(3.0) / 4 * cube.size; // to the center of a child
        for (int octant = 0; octant < 8; ++octant)
            refine(cube.child(octant), depth + 1, least + step);
    }

    void keepUpTo(double farthest, std::vector<std::uint32_t>& kept) const
    {
        std::size_t count = 0;
        for (std::size_t k = 0; k < kept.size(); ++k)
            if (mDistances[k] <= farthest) kept[count++] = kept[k];
        kept.resize(count);
    }

    /// @param nearest  triangles, all as far from @a p.
    bool isBehind(const std::vector<std::uint32_t>& nearest, const Vec3d& p) const
    {
        const auto height = [&](const Candidate& t, const Vec3d& from) {
            return t.normal.dot(p - from);
        };
        if (nearest.size() == 1) {
            const Candidate& only = mCandidates[nearest.front()];
            return height(only, only.corners[0]) < 0;
        }
        double sum = 0;
        for (const std::uint32_t n : nearest) {
            const NearestPlace near(p, mCandidates[n].corners);
            sum += near.angle * height(mCandidates[n], near.place);
        }
        return sum < 0;
    }

    const PlacedTriangles& mTriangles;
    double mReach;
    double mTie; ///< difference of distances, voxels, below which triangles are equally near
    std::vector<Candidate> mCandidates;
    std::array<std::vector<std::uint32_t>, 5> mKept; ///< by depth
    std::vector<double> mDistances;                  ///< of those kept last
    std::unique_ptr<Leaf> mLeaf;
};

/// Descends from a cube that holds all triangles to the leaves within reach of some.
class Descent
{
public:
    Descent(const PlacedTriangles& triangles, double reach, Interrupter& progress)
        : mTriangles(triangles), mReach(reach), mProgress(progress),
          mMeasures([this] { return LeafMeasure(mTriangles, mReach); })
    {
    }

    Leaves run()
    {
        const Vec3d low = mTriangles.voxels(mTriangles.tree.box().min()) - Vec3d::Constant(mReach);
        const Vec3d high = mTriangles.voxels(mTriangles.tree.box().max()) + Vec3d::Constant(mReach);
        const Coord first(int(std::floor(low[0])), int(std::floor(low[1])),
                          int(std::floor(low[2])));
        Cube cube{first & ~(kBlockDim - 1), kBlockDim};
        while ((high - vecOf(cube.first)).maxCoeff() >= cube.size) cube.size *= 2;
        descend(cube, 0);
        Leaves leaves;
        for (Leaves& some : mLeaves)
            std::move(some.begin(), some.end(), std::back_inserter(leaves));
        std::sort(leaves.begin(), leaves.end(),
                  [](const auto& a, const auto& b) { return a->origin() < b->origin(); });
        return leaves;
    }

private:
    /// @param slot  of the triangle nearest so far, as TriangleTree::squaredDistance() takes it.
    void descend(const Cube& cube, std::size_t slot)
    {
        mProgress.check();
        const double distance =
            std::sqrt(mTriangles.tree.squaredDistance(mTriangles.place(cube.center()), slot)) /
            mTriangles.voxelSize;
        if (!(distance < mReach + cube.radius())) return;
        if (cube.size == kBlockDim) {
            if (auto leaf = mMeasures.local().measure(cube, distance))
                mLeaves.local().push_back(std::move(leaf));
            return;
        }
        tbb::task_group children;
        for (int octant = 0; octant < 8; ++octant)
            children.run([=] { descend(cube.child(octant), slot); });
        children.wait();
    }

    const PlacedTriangles& mTriangles;
    double mReach;
    Interrupter& mProgress;
    tbb::enumerable_thread_specific<LeafMeasure> mMeasures;
    tbb::enumerable_thread_specific<Leaves> mLeaves;
};

} // namespace

Leaves leavesNear(const PlacedTriangles& triangles, double reach, Interrupter& progress)
{
    return Descent(triangles, reach, progress).run();
}

} // namespace mpuvdb
