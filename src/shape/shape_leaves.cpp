// Leaves of shapes: fields, level sets, meshes.
#include "core/whole_triangle.h"
#include "grid/solid_bounds.h"
#include "grid/transform_lattice.h"
#include "modelling/resample.h"
#include "sampling/band.h"
#include "shape_node.h"

#include "field/point_field.h"
#include <mpuvdb/error.h>
#include <mpuvdb/explained.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/sampling.h>

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

/// The number of seed blocks of a surface of random orientation, times their face, by its area:
/// 1.5 where it meets their cubes, more as seeds are found by the balls around them.
/// [tuned: plan_bench]
constexpr double kBlocksPerArea = 1.7;

/// The box where a field is clipped, so far from the region that its faces' band does not reach in.
Box3d clipBox(const Request& own)
{
    return grown(own.region, own.band() + 2 * own.lattice.voxelSize);
}

/// @a made, with its comparison with its source, whose findings become notes.
LevelSet withExplained(const LevelSet& made, const std::shared_ptr<const Explained>& explained,
                       Interrupter& progress)
{
    if (!explained) return made;
    for (const std::string& finding : explained->findings()) progress.note(finding);
    return LevelSet(made.gridPtr(), explained);
}

class FieldNode final : public Shape::Node
{
public:
    FieldNode(FieldPtr field, std::string name)
        : Node(std::move(name), {}, field->bounds()), mField(std::move(field))
    {
    }

    Request requestOf(std::size_t, const Request&) const override { return {}; }

    double area(const Box3d& region) const override
    {
        constexpr double kBlocksAcross = 24; // blocks along the box [tuned: plan_bench]
        const Box3d box = bounds().intersection(region);
        if (box.isEmpty() || !isFinite(box)) return 0;
        const double edge = box.sizes().maxCoeff() / kBlocksAcross;
        if (!(edge > 0)) return 0;
        const FieldPtr part = region.contains(bounds()) ? mField : makeClippedField(mField, box);
        // Only blocks are counted: this lattice may be finer than a grid's.
        const Lattice coarse{box.center(), edge / kBlockDim};
        return double(part->seedBlocks(coarse).size()) * edge * edge / kBlocksPerArea;
    }

    FieldPtr field() const override
    {
        const auto* const points = dynamic_cast<const PointField*>(mField.get());
        const bool isSlow = points && points->inBatches(); // at single places
        return isSlow ? nullptr : mField;
    }

    double workingBytes(const Request& own) const override
    {
        const double h = own.lattice.voxelSize;
        const bool sampled = mField->isDistance() && own.halfWidth <= kMaxNearBand;
        return sampled ? 0 : distanceBytes(area(own.region), h);
    }

    LevelSet make(const Inputs&, const Request& own, std::uint64_t maxBytes,
                  Interrupter& progress) const override
    {
        const Box3d box = clipBox(own);
        const FieldPtr field = box.contains(bounds()) ? mField : makeClippedField(mField, box);
        SampleSettings settings;
        settings.lattice = own.lattice;
        settings.halfWidth = own.halfWidth;
        settings.maxBytes = maxBytes;
        settings.mayBeEmpty = true;
        const LevelSet made = sampleField(*field, settings, &progress);
        return withExplained(made, field == mField ? explainedOf(made, progress) : nullptr,
                             progress);
    }

protected:
    Ptr movedSelf(const Eigen::Affine3d& motion, Moved&) const override
    {
        return fieldNode(makeMovedField(mField, motion), name());
    }
    Ptr warpedSelf(const std::shared_ptr<const Warp>& warp, const std::string& how,
                   Moved&) const override
    {
        return fieldNode(makeWarpedField(mField, warp), name() + ", " + how);
    }

private:
    /// The comparison with the points; null where the field was not made of points.
    std::shared_ptr<const Explained> explainedOf(const LevelSet& made, Interrupter& progress) const
    {
        const auto* const points = dynamic_cast<const MpuField*>(mField.get());
        if (!points) return nullptr;
        auto explained = std::make_shared<Explained>();
        explained->by = explain(made, *points, std::nullopt, &progress);
        return explained;
    }

    FieldPtr mField;
};

class GridNode final : public Shape::Node
{
public:
    GridNode(LevelSet levelSet, std::string name)
        : Node(std::move(name), {}, solidBounds(levelSet)), mLevelSet(std::move(levelSet)),
          mLattice(mLevelSet.lattice())
    {
    }

    Request requestOf(std::size_t, const Request&) const override { return {}; }

    /// The band holds 2 x half-width voxels for each one that the surface meets.
    double area(const Box3d&) const override
    {
        const double h = mLattice.voxelSize;
        return double(mLevelSet.grid().activeVoxelCount()) * h * h / (2 * mLevelSet.halfWidth());
    }

    double workingBytes(const Request& own) const override
    {
        const double h = mLattice.voxelSize, surface = area(own.region);
        if (isThere(own.lattice))
            return own.halfWidth > mLevelSet.halfWidth() ? widerBytes(surface, own.halfWidth) : 0;
        const double needed = widthToResample(mLattice, own.lattice, own.halfWidth);
        double bytes = kResamplingGrids * gridBytes(surface, own.lattice.voxelSize, own.halfWidth);
        if (needed > mLevelSet.halfWidth())
            bytes += widerBytes(surface, needed) + gridBytes(surface, h, needed);
        if (isSearched(mLattice, own.lattice)) bytes += distanceBytes(surface, h);
        return bytes;
    }

    LevelSet make(const Inputs&, const Request& own, std::uint64_t,
                  Interrupter& progress) const override
    {
        return isThere(own.lattice) ? inBand(mLevelSet, own.halfWidth, progress)
                                    : resample(mLevelSet, own.lattice, own.halfWidth, &progress);
    }

    double voxelSize() const override { return mLattice.voxelSize; }

    const LevelSet& levelSet() const { return mLevelSet; }

private:
    /// Memory to widen the band to @a halfWidth voxels about a surface of an area, bytes.
    double widerBytes(double surface, double halfWidth) const
    {
        const double h = mLattice.voxelSize;
        return distanceBytes(offsetArea(surface, halfWidth * h), h);
    }
    bool isThere(const Lattice& lattice) const
    {
        return mLattice.origin == lattice.origin && mLattice.voxelSize == lattice.voxelSize;
    }

    LevelSet mLevelSet;
    Lattice mLattice;
};

class MeshNode final : public Shape::Node
{
public:
    MeshNode(std::shared_ptr<const Mesh> mesh, const std::optional<RepairSettings>& repair,
             std::string name)
        : Node(std::move(name), {}, boundsOf(*mesh, repair)), mMesh(std::move(mesh)),
          mRepair(repair)
    {
    }

    Request requestOf(std::size_t, const Request&) const override { return {}; }

    double area(const Box3d&) const override
    {
        double area = 0;
        for (const Mesh::Triangle& t : mMesh->triangles) {
            if (!isWhole(*mMesh, t)) continue;
            const Vec3f &a = mMesh->positions[t[0]], &b = mMesh->positions[t[1]],
                        &c = mMesh->positions[t[2]];
            area += 0.5 * double((b - a).cross(c - a).norm());
        }
        return mRepair ? 2 * area : area; // what closes holes, and both sides of walls
    }

    LevelSet make(const Inputs&, const Request& own, std::uint64_t maxBytes,
                  Interrupter& progress) const override
    {
        SampleSettings settings;
        settings.lattice = own.lattice;
        settings.halfWidth = own.halfWidth;
        settings.maxBytes = maxBytes;
        const LevelSet made = mRepair ? voxelize(*mMesh, settings, *mRepair, &progress)
                                      : voxelize(*mMesh, settings, &progress);
        return withExplained(made, made.explained(), progress);
    }

protected:
    Ptr movedSelf(const Eigen::Affine3d& motion, Moved&) const override
    {
        Mesh mesh;
        mesh.frame = motion * mMesh->frame;
        mesh.positions.reserve(mMesh->positions.size());
        for (const Vec3f& p : mMesh->positions)
            mesh.positions.push_back((motion.linear() * p.cast<double>()).cast<float>());
        mesh.triangles = mMesh->triangles;
        if (motion.linear().determinant() < 0)
            for (Mesh::Triangle& t : mesh.triangles) std::swap(t[1], t[2]);
        std::optional<RepairSettings> repair = mRepair;
        if (repair) {
            const double scale = std::cbrt(std::abs(motion.linear().determinant()));
            repair->holes *= scale;
            repair->thickness *= scale;
        }
        return meshNode(std::make_shared<const Mesh>(std::move(mesh)), repair, name());
    }

private:
    static Box3d boundsOf(const Mesh& mesh, const std::optional<RepairSettings>& repair)
    {
        Box3d box;
        for (const Mesh::Triangle& t : mesh.triangles) {
            if (repair && !isWhole(mesh, t)) continue;
            for (const std::uint32_t corner : t) {
                if (corner >= mesh.positions.size())
                    throw InputError("mesh: a triangle names a vertex that is not there. Write the "
                                     "mesh again from its source, or repair it");
                box.extend(mesh.world(corner));
            }
        }
        if (!repair || box.isEmpty()) return box;
        const Vec3d wall = Vec3d::Constant(repair->thickness / 2);
        return {box.min() - wall, box.max() + wall};
    }

    std::shared_ptr<const Mesh> mMesh;
    std::optional<RepairSettings> mRepair;
};

} // namespace

Shape::Node::Ptr fieldNode(FieldPtr field, std::string name)
{
    return std::make_shared<FieldNode>(std::move(field), std::move(name));
}

Shape::Node::Ptr gridNode(LevelSet levelSet, std::string name)
{
    return std::make_shared<GridNode>(std::move(levelSet), std::move(name));
}

Shape::Node::Ptr meshNode(std::shared_ptr<const Mesh> mesh,
                          const std::optional<RepairSettings>& repair, std::string name)
{
    return std::make_shared<MeshNode>(std::move(mesh), repair, std::move(name));
}

const LevelSet* levelSetIn(const Shape::Node& node)
{
    const auto* grid = dynamic_cast<const GridNode*>(&node);
    return grid ? &grid->levelSet() : nullptr;
}

} // namespace mpuvdb
