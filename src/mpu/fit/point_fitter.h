// Local fits that go through one input point each, for interpolation [Ohtake03 §6].
#pragma once
#include "cell_fitter.h"

#include <unordered_map>

namespace mpuvdb
{

/// Fits through points, one per point and subtree, with the scratch memory of one thread.
class PointFitter
{
public:
    /// A fit in the tree, and the radius of its ball of neighbors.
    struct PointFit {
        std::uint32_t index = 0;
        double radius = 0;
    };

    PointFitter(const SortedPoints& points, const RootCube& root, const MpuSettings& settings)
        : mPoints(points), mRoot(root), mMinPoints(std::size_t(settings.minPoints))
    {
    }

    /// Forget the fits before another tree.
    void clear() { mFits.clear(); }

    /// Up to two points (indices in @a ball, which holds all points of the cell) in @a cell.
    std::size_t pointsIn(const OctreeCell& cell, const PointBatch& ball,
                         std::array<std::size_t, 2>& found) const;

    /// The fit through point @a n of the last ball of @a path to its N_min nearest neighbors;
    /// stored in @a tree by the first call. @a path: balls of @a cell and its ancestors.
    PointFit fitThrough(std::size_t n, const OctreeCell& cell, const std::vector<Ball>& path,
                        OctreeDraft& tree);
    /// A fit of its own through point @a n of @a ball, to the points of @a around within @a radius;
    /// returns its index.
    std::uint32_t fitWithin(const PointBatch& ball, std::size_t n, double radius,
                            const PointBatch& around, OctreeDraft& tree);

private:
    struct Key {
        Vec3f at;
        bool operator==(const Key& other) const { return at == other.at; }
    };
    struct Hash {
        std::size_t operator()(const Key& key) const;
    };
    double gatherNearest(const Vec3d& at, const OctreeCell& cell, const std::vector<Ball>& path);
    Quadric fitNear(const Vec3f& at, const Vec3d& normal, double radius);

    const SortedPoints& mPoints;
    const RootCube& mRoot;
    std::size_t mMinPoints;
    BatchFilter mFilter;
    PointBatch mWide, mNear;
    CellPoints mCell;
    std::unordered_map<Key, PointFit, Hash> mFits;
};

} // namespace mpuvdb
