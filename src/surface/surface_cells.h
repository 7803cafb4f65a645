// The surface of a level set, cell by cell: triangles as the mesh's sheets are connected, and the
// distance's quadric around them.
#pragma once
#include "cell_sheets.h"
#include "grid/leaf_halo.h"
#include "joined_faces.h"
#include "octant_plane.h"
#include <mpuvdb/field.h>

#include <array>
#include <openvdb/openvdb.h>

namespace mpuvdb
{

/// Values in voxels, of a leaf and of the voxels around it that cells based in the leaf use.
class LeafWindow
{
public:
    using Leaf = openvdb::FloatTree::LeafNodeType;
    /// @param halfWidth  of the band, voxels.
    LeafWindow(const openvdb::FloatTree& tree, double voxelSize, double halfWidth)
        : mAccess(tree), mPerVoxel(float(1 / voxelSize)), mRim(float(halfWidth * (1 - 1e-5)))
    {
    }

    void load(const Leaf& leaf) { mValues.load(mAccess, leaf.origin(), mPerVoxel); }
    /// Value of a voxel relative to the leaf, each coordinate in [-1, 9].
    float operator()(int x, int y, int z) const { return mValues[Values::index(x, y, z)]; }
    float operator()(const Vec3i& p) const { return (*this)(p[0], p[1], p[2]); }
    /// The plane at a voxel, each coordinate in [0,8].
    OctantPlane planeAt(const Vec3i& p) const
    {
        const auto at = std::size_t(Values::index(p[0], p[1], p[2]));
        return octantPlane(&mValues.value[at], Values::kStride, 1);
    }
    /// Whether a value lies in the band.
    bool isKnown(float value) const { return value < mRim && value > -mRim; }

private:
    using Values = BlockWindow<1, 2>; ///< of the corners of cells, and their neighbors
    openvdb::tree::ValueAccessor<const openvdb::FloatTree> mAccess;
    float mPerVoxel, mRim;
    Values mValues;
};

/// A vertex of the surface, on the edge from a voxel to the next along an axis.
struct SurfaceVertex {
    Vec3i from; ///< voxel, relative to the leaf
    int axis = 0;
    Vec3d position; ///< voxels, relative to the leaf
};

/// A triangle, counter-clockwise seen from outside: the middle of a sheet's vertices in a cell, and
/// two of them.
struct SurfaceTriangle {
    Vec3d middle;
    SurfaceVertex from, to;
};

/// The triangles of one cell: fans about the middle of each sheet.
class CellFans
{
public:
    /// The triangles of the cell from voxel @a base to base + (1,1,1), which is the cell @a at of
    /// the grid.
    CellFans(const LeafWindow& window, const Vec3i& base, const JoinedFaces& faces,
             const openvdb::Coord& at);
    const SurfaceTriangle* begin() const { return mTriangles.data(); }
    const SurfaceTriangle* end() const { return begin() + mCount; }
    /// Number of sheets, each with its middle.
    int sheets() const { return mSheets; }

private:
    struct Crossings;
    static Vec3d middleOf(const LeafWindow& window, const Vec3i& base, const Crossings& crossings,
                          const CellSheets& sheets, std::size_t sheet);

    /// As many as there are segments across six faces. [derived: two across each]
    std::array<SurfaceTriangle, 12> mTriangles;
    int mCount = 0, mSheets = 0;
};

/// Whether the surface crosses the cell at @a base.
bool isCrossed(const LeafWindow& window, const Vec3i& base);

/// The distance around a cell's middle, up to second order.
struct CellQuadric {
    bool smooth = false; ///< false beside a crease or the band's rim
    Vec3d middle = Vec3d::Zero();
    double value = 0;
    Vec3d gradient = Vec3d::Zero();
    Eigen::Matrix3d bend = Eigen::Matrix3d::Zero(); ///< second derivatives

    CellQuadric(const LeafWindow& window, const Vec3i& base);
    double valueAt(const Vec3d& p) const
    {
        const Vec3d d = p - middle;
        return value + d.dot(gradient + 0.5 * (bend * d));
    }
    Vec3d gradientAt(const Vec3d& p) const { return gradient + bend * (p - middle); }
};

} // namespace mpuvdb
