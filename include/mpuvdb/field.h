// A signed function of space that can be sampled on a voxel lattice, block by block.
// Values are distances in world units, negative inside.
#pragma once
#include <mpuvdb/vec.h>

#include <array>
#include <memory>
#include <vector>

namespace mpuvdb
{

/// A voxel lattice: voxel (i,j,k) has its center at origin + voxelSize * (i,j,k), world units.
struct Lattice {
    Vec3d origin = Vec3d::Zero();
    double voxelSize = 1;
};

/// Edge of a block, voxels. [derived: that of an OpenVDB leaf]
constexpr int kBlockDim = 8;
/// Voxels of a block. [derived: kBlockDim^3]
constexpr int kBlockVoxels = kBlockDim * kBlockDim * kBlockDim;

/// Values of block b: voxels 8b .. 8b+7 on each axis, z fastest (OpenVDB's leaf order).
using BlockValues = std::array<float, kBlockVoxels>;

/// The field at one point.
struct FieldSample {
    double value = 0;               ///< signed distance, world units, negative inside
    Vec3d gradient = Vec3d::Zero(); ///< of the value; about unit near the surface
    int level = -1;                 ///< deepest octree level that contributes; -1: none
    bool supported = false;         ///< by data, and not by extrapolation
};

/// Evaluates blocks for one thread, and keeps its scratch memory. A block's values do not depend on
/// the blocks evaluated before; neighboring blocks after each other are fastest.
class BlockSampler
{
public:
    virtual ~BlockSampler() = default;
    /// Sample one block, world units. All values are finite; beyond the band only their sign
    /// counts.
    virtual void evaluate(const Vec3i& block, BlockValues& values) = 0;
};

/// Evaluates a field at one place after the other for one thread; fastest where each is near the
/// one before it. A sample does not depend on the places evaluated before.
class PointEvaluator
{
public:
    virtual ~PointEvaluator() = default;
    /// The sample at a world position: the same bits as Field::evaluate().
    virtual FieldSample evaluate(const Vec3d& position) = 0;
};

/// A place on a surface.
struct SurfacePlace {
    Vec3d position = Vec3d::Zero(); ///< world units
    Vec3d normal = Vec3d::Zero();   ///< unit, outward
};

/// The support of a surface by data. All members are safe to call from many threads.
class Coverage
{
public:
    virtual ~Coverage() = default;
    /// One value per place, in [0,1]: 1 where data support the surface, 0 where it is invented.
    /// Fastest where each place is near the one before it; no value depends on the others.
    virtual void evaluate(const std::vector<SurfacePlace>& places,
                          std::vector<float>& values) const = 0;
    /// Median distance between points, world units: the scale on which values change; 0: exact.
    virtual double spacing() const = 0;
};

/// An immutable signed function of space; all members are safe to call from many threads.
class Field
{
public:
    virtual ~Field() = default;
    /// A box around the zero set, world units; infinite if the zero set is.
    virtual Box3d bounds() const = 0;
    /// The sample at a world position.
    virtual FieldSample evaluate(const Vec3d& position) const = 0;
    /// Blocks to start the band in: every component of the zero set meets one of them. Sorted by
    /// (x,y,z), unique. @throws LimitError beyond the index range, UsageError if unbounded.
    virtual std::vector<Vec3i> seedBlocks(const Lattice& lattice) const = 0;
    /// Those of seedBlocks() that meet @a box (world units), and perhaps others of them: all, by
    /// default.
    virtual std::vector<Vec3i> seedBlocksIn(const Lattice& lattice, const Box3d& /*box*/) const
    {
        return seedBlocks(lattice);
    }
    /// Number of data points in @a box (world units), at least @a limit if there are that many: few
    /// data mark an artifact. @a limit where the field is not made from data.
    virtual std::size_t countData(const Box3d& box, std::size_t limit) const
    {
        (void)box;
        return limit;
    }
    /// Whether the value is the distance near the zero set. If not, only its sign and zero set
    /// count, and grids made from it are re-distanced.
    virtual bool isDistance() const { return true; }
    /// Whether the value is the distance far from the zero set, too.
    virtual bool isDistanceFar() const { return false; }
    /// The largest norm of the gradient near the zero set: 1 for a distance.
    virtual double steepness() const { return 1; }
    /// A sampler of blocks on @a lattice, exact where |value| <= @a band (world units). The field
    /// has to outlive it.
    virtual std::unique_ptr<BlockSampler> sampler(const Lattice& lattice, double band) const = 0;
    /// An evaluator of places one after the other, which the field has to outlive; fastest where
    /// they are about @a spacing apart (world units). By default it calls evaluate().
    virtual std::unique_ptr<PointEvaluator> evaluator(double spacing) const;
};

} // namespace mpuvdb
