#include "outer_walls.h"

#include "spatial/triangle_tree.h"
#include "winding_number.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <memory>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

using Exact = std::array<Vec3d, 3>;

double sizeOf(const Exact& t)
{
    return (t[1] - t[0]).cross(t[2] - t[0]).norm() / 2;
}

/// Cuts triangles where they enter a solid.
class WallCutter
{
public:
    WallCutter(const OrientedTriangles& solid, double voxelSize, Interrupter& progress)
        : mVoxelSize(voxelSize)
    {
        if (solid.mesh.triangles.empty()) return;
        mTree = std::make_unique<const TriangleTree>(solid.mesh, progress);
        mWinding = std::make_unique<const WindingNumber>(*mTree, solid);
    }

    /// Append the pieces of @a t that are outside. @return whether all of it is.
    bool cut(const Exact& t, std::vector<Exact>& outside) const
    {
        const Vec3d middle = (t[0] + t[1] + t[2]) / 3;
        std::size_t k = 0; // the longest side
        for (std::size_t m = 1; m < 3; ++m)
            if ((t[(m + 1) % 3] - t[m]).norm() > (t[(k + 1) % 3] - t[k]).norm()) k = m;
        if (!((t[(k + 1) % 3] - t[k]).norm() > mVoxelSize) || !mayCross(t, middle)) {
            if (mWinding && mWinding->at(middle) > 0.5) return false;
            outside.push_back(t);
            return true;
        }
        const Vec3d half = (t[k] + t[(k + 1) % 3]) / 2;
        const std::size_t first = outside.size();
        const bool isFirst = cut({t[k], half, t[(k + 2) % 3]}, outside);
        if (!cut({half, t[(k + 1) % 3], t[(k + 2) % 3]}, outside) || !isFirst) return false;
        outside.resize(first);
        outside.push_back(t);
        return true;
    }

private:
    bool mayCross(const Exact& t, const Vec3d& middle) const
    {
        if (!mTree) return false;
        double radius2 = 0;
        for (const Vec3d& corner : t) radius2 = std::max(radius2, (corner - middle).squaredNorm());
        std::size_t slot = 0;
        return mTree->squaredDistance(middle, radius2, slot) < radius2;
    }

    double mVoxelSize;
    std::unique_ptr<const TriangleTree> mTree; ///< null without a solid
    std::unique_ptr<const WindingNumber> mWinding;
};

} // namespace

OuterWalls outerWalls(const Mesh& walls, const OrientedTriangles& solid, double voxelSize,
                      Interrupter& progress)
{
    const WallCutter cutter(solid, voxelSize, progress);
    std::vector<std::vector<Exact>> pieces(walls.triangles.size());
    const auto cornersOf = [&](std::size_t n) {
        const Mesh::Triangle& t = walls.triangles[n];
        return Exact{walls.positions[t[0]].cast<double>(), walls.positions[t[1]].cast<double>(),
                     walls.positions[t[2]].cast<double>()};
    };
    tbb::parallel_for(std::size_t(0), pieces.size(), [&](std::size_t n) {
        progress.check();
        cutter.cut(cornersOf(n), pieces[n]);
    });
    OuterWalls outer;
    outer.mesh.frame = walls.frame;
    for (std::size_t n = 0; n < pieces.size(); ++n) {
        double outside = 0;
        for (const Exact& piece : pieces[n]) {
            outside += sizeOf(piece);
            const auto first = std::uint32_t(outer.mesh.positions.size());
            for (const Vec3d& corner : piece) outer.mesh.positions.push_back(corner.cast<float>());
            outer.mesh.triangles.push_back({first, first + 1, first + 2});
        }
        outer.hasOutside.push_back(outside > 0);
        outer.areaOutside += outside;
        outer.areaWithin += std::max(0.0, sizeOf(cornersOf(n)) - outside);
    }
    return outer;
}

} // namespace mpuvdb
