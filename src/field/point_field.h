// Fields given by a function of the point: their seeds, and their blocks.
#pragma once
#include "core/boxes.h"
#include <mpuvdb/fields.h>

#include <functional>

namespace mpuvdb
{

/// Step of central differences, relative to the extent of the solid. [derived: of the order of the
/// cube root of double's rounding]
constexpr double kRelativeStep = 1e-6;

using CubeTest = std::function<bool(const Vec3d& center, double radius)>;
/// The blocks of @a lattice that meet @a box (world units) and for whose cubes, and all larger ones
/// of an octree around them, @a mayMeet is true; sorted by (x,y,z), unique.
/// @throws LimitError for more blocks than can be kept, or beyond the index range.
std::vector<Vec3i> descendBlocks(const Lattice& lattice, const Box3d& box, const CubeTest& mayMeet);

/// Cubes to be tested at once.
struct CubeBatch {
    std::vector<Vec3d> centers;
    std::vector<double> radii; ///< of the balls around them
};
using CubesTest = std::function<void(const CubeBatch& cubes, std::vector<char>& mayMeet)>;
/// descendBlocks() for tests that cost much less for many cubes than for one after the other.
std::vector<Vec3i> descendBlocksInBatches(const Lattice& lattice, const Box3d& box,
                                          const CubesTest& mayMeet);

/// Sort by (x,y,z) and remove duplicates.
void sortBlocks(std::vector<Vec3i>& blocks);

/// A box of blocks.
struct BlockRange {
    Vec3i low, high; ///< both included
};
/// The blocks of @a lattice whose cubes meet @a box.
/// @throws LimitError beyond the index range.
BlockRange blocksOf(const Lattice& lattice, const Box3d& box);

/// The cube of block @a block: its voxels and half a voxel around them, so that cubes fill space.
Box3d cubeOf(const Lattice& lattice, const Vec3i& block);

/// Distance from the faces of @a box, negative inside.
double boxDistance(const Box3d& box, const Vec3d& p);

/// Gradient of boxDistance(), of unit length.
Vec3d boxNormal(const Box3d& box, const Vec3d& p);

/// A function of the point. Derived classes give its value, and bounds of its change.
class PointField : public Field
{
public:
    /// The value at @a p, world units.
    virtual double value(const Vec3d& p) const = 0;
    /// A value of the same sign and no larger magnitude, where that is cheaper.
    virtual double bound(const Vec3d& p) const { return value(p); }
    /// The values at many points.
    virtual void values(const std::vector<Vec3d>& points, std::vector<double>& values) const;
    /// Whether values() costs much less than value() of one point after the other.
    virtual bool inBatches() const { return false; }
    /// Largest change of bound() from @a center within @a radius.
    virtual double change(const Vec3d& /*center*/, double radius) const
    {
        return steepness() * radius;
    }
    /// The blocks within @a box that the zero set may meet: all of them, or at least one per
    /// component of the zero set within the box.
    virtual std::vector<Vec3i> seedsWithin(const Lattice& lattice, const Box3d& box) const;

    /// @throws UsageError if the field is unbounded.
    std::vector<Vec3i> seedBlocks(const Lattice& lattice) const override;
    std::unique_ptr<BlockSampler> sampler(const Lattice& lattice, double band) const override;

protected:
    /// The gradient by central differences of @a step.
    Vec3d slope(const Vec3d& p, double step) const;
};

/// Evaluator of a field of class Made that is made from another one: made.sample(p, source) is its
/// sample where source.evaluate() gives the other's.
template <typename Made>
class MadeEvaluator final : public PointEvaluator
{
public:
    MadeEvaluator(const Made& made, const Field& source, double spacing)
        : mMade(made), mSource(source.evaluator(spacing))
    {
    }
    FieldSample evaluate(const Vec3d& p) override { return mMade.sample(p, *mSource); }

private:
    const Made& mMade;
    std::unique_ptr<PointEvaluator> mSource;
};

/// The field that another one is made from.
class Source
{
public:
    explicit Source(FieldPtr field);

    const Field& field() const { return *mField; }
    const FieldPtr& pointer() const { return mField; }
    const PointField* points() const { return mPoints; }
    double value(const Vec3d& p) const;
    void values(const std::vector<Vec3d>& points, std::vector<double>& values) const;
    bool inBatches() const { return mPoints && mPoints->inBatches(); }
    /// @{ As PointField's; for other fields with a safety factor.
    double bound(const Vec3d& p) const;
    double change(const Vec3d& center, double radius) const;
    /// @}
    std::vector<Vec3i> seedsWithin(const Lattice& lattice, const Box3d& box) const;

private:
    FieldPtr mField;
    const PointField* mPoints; ///< the same field, or null
};

/// The box of all space.
Box3d wholeSpace();

} // namespace mpuvdb
