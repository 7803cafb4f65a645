// The surface of a level set, cell by cell: triangles of the piecewise linear distance on
// tetrahedra, closed and without ambiguity; and how far the curved surface lies from them.
#pragma once
#include <mpuvdb/vec.h>

#include <openvdb/openvdb.h>

#include <array>

namespace mpuvdb
{

/// A leaf's values and those around it that cells based in the leaf read, in voxels.
class LeafWindow
{
public:
    using Leaf = openvdb::FloatTree::LeafNodeType;
    static constexpr int kBelow = 1, kAbove = 2, kDim = int(Leaf::DIM) + kBelow + kAbove;

    /// @param halfWidth  of the band, voxels.
    LeafWindow(const openvdb::FloatTree& tree, double voxelSize, double halfWidth)
        : mAccess(tree), mPerVoxel(float(1 / voxelSize)), mRim(float(halfWidth * (1 - 1e-5)))
    {
    }

    void load(const Leaf& leaf);
    /// Of a voxel relative to the leaf, each in [-1, 9].
    float operator()(int x, int y, int z) const
    {
        return mValues[((x + kBelow) * kDim + y + kBelow) * kDim + z + kBelow];
    }
    float operator()(const Vec3i& p) const { return (*this)(p[0], p[1], p[2]); }
    /// Whether a value lies in the band, not beyond.
    bool isKnown(float value) const { return value < mRim && value > -mRim; }

private:
    openvdb::tree::ValueAccessor<const openvdb::FloatTree> mAccess;
    float mPerVoxel, mRim;
    std::array<float, kDim * kDim * kDim> mValues;
};

/// A vertex of the surface: on the edge that starts at a voxel towards another of its cell.
struct SurfaceVertex {
    Vec3i from;     ///< voxel, relative to the leaf
    int to = 0;     ///< bits x, y, z of the step
    Vec3d position; ///< voxels, relative to the leaf
};

/// Counter-clockwise seen from outside.
using SurfaceTriangle = std::array<SurfaceVertex, 3>;

/// The triangles of one cell.
class CellTriangles
{
public:
    /// Of the cell from voxel @a base to base + (1,1,1).
    CellTriangles(const LeafWindow& window, const Vec3i& base);
    const SurfaceTriangle* begin() const { return mTriangles.data(); }
    const SurfaceTriangle* end() const { return begin() + mCount; }

private:
    void addTetrahedron(const std::array<int, 4>& corners);
    void addTriangle(const std::array<SurfaceVertex, 3>& corners, const Vec3d& outward);
    SurfaceVertex vertex(int a, int b) const;

    Vec3i mBase;
    std::array<double, 8> mValues;
    std::array<SurfaceTriangle, 12> mTriangles;
    int mCount = 0;
};

/// Whether the surface passes through the cell at @a base.
bool isCrossed(const LeafWindow& window, const Vec3i& base);

/// The distance about a cell's middle up to second order.
struct CellQuadric {
    bool smooth = false; ///< else there is a crease, or the band ends nearby
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
