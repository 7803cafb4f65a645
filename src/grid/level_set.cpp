#include <mpuvdb/level_set.h>

#include "band_limits.h"
#include "transform_lattice.h"
#include <mpuvdb/error.h>

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numeric>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

void requireFiniteTiles(const openvdb::FloatGrid& grid)
{
    if (!std::isfinite(grid.background()))
        throw InputError(fmt::format("grid '{}': its background is {}, which is not finite. Write "
                                     "it again from its source",
                                     grid.getName(), grid.background()));
    auto tile = grid.cbeginValueAll();
    tile.setMaxDepth(openvdb::FloatTree::ValueAllCIter::LEAF_DEPTH - 1);
    for (; tile; ++tile) {
        if (std::isfinite(*tile)) continue;
        const openvdb::Coord at = tile.getCoord();
        throw InputError(fmt::format("grid '{}': the values about voxel {}, {}, {} are not finite. "
                                     "Write it again from its source",
                                     grid.getName(), at.x(), at.y(), at.z()));
    }
}

/// Distance from the origin, voxels. [derived: OpenVDB's copies of a transform, and its files, have
/// the difference of places a voxel apart for the voxel size, rounded as the places are: by less
/// than a millionth, which is what latticeOf() takes]
constexpr double kMaxReach = std::int64_t(1) << 33;

} // namespace

std::optional<Lattice> latticeOf(const openvdb::math::Transform& transform)
{
    if (!transform.isLinear()) return std::nullopt;
    const openvdb::math::Mat4d m = transform.baseMap()->getAffineMap()->getMat4();
    const double size = m(0, 0);
    if (!(size > 0) || !std::isfinite(size)) return std::nullopt;
    // Voxel sizes that passed through files as text or floats differ a little per axis.
    const double tolerance = 1e-6 * size;
    for (int row = 0; row < 3; ++row)
        for (int column = 0; column < 3; ++column)
            if (!(std::abs(m(row, column) - (row == column ? size : 0)) <= tolerance))
                return std::nullopt;
    const Lattice lattice{{m(3, 0), m(3, 1), m(3, 2)}, size};
    if (!lattice.origin.allFinite()) return std::nullopt;
    return lattice;
}

void requireUniformVoxels(const openvdb::GridBase& grid)
{
    if (latticeOf(grid.transform())) return;
    throw InputError(fmt::format("grid '{}': {}. Resample it to uniform voxels along the axes "
                                 "where it comes from, for example with Houdini's VDB Resample",
                                 grid.getName(), whyNoLattice(grid.transform())));
}

std::string whyNoLattice(const openvdb::math::Transform& transform)
{
    /// Relative difference of voxels' edges that is none. [derived: as latticeOf() has it]
    constexpr double kRounding = 1e-6;
    if (!transform.isLinear()) return "its voxels are those of a frustum, not cubes";
    const openvdb::Vec3d size = transform.voxelSize();
    const double least = std::min({size.x(), size.y(), size.z()}),
                 most = std::max({size.x(), size.y(), size.z()});
    const openvdb::math::Mat4d m = transform.baseMap()->getAffineMap()->getMat4();
    const std::string what = fmt::format("(transform {}, voxels of {:.6g} x {:.6g} x {:.6g})",
                                         transform.mapType(), size.x(), size.y(), size.z());
    if (most - least > kRounding * most) return "its voxels are not cubes " + what;
    return m.getMat3().det() < 0 ? "its transform mirrors an axis or exchanges two " + what
                                 : "its transform turns or shears the axes of its voxels " + what;
}

void setLattice(openvdb::GridBase& grid, const Lattice& lattice)
{
    grid.setTransform(openvdb::math::Transform::createLinearTransform(lattice.voxelSize));
    const Vec3d& o = lattice.origin;
    if (o != Vec3d::Zero()) grid.transform().postTranslate({o[0], o[1], o[2]});
}

LevelSet emptyLevelSet(const Lattice& lattice, double halfWidth, const std::string& name)
{
    requireVoxelSize(lattice.voxelSize);
    const Vec3d& o = lattice.origin;
    if (const double reach = o.cwiseAbs().maxCoeff() / lattice.voxelSize; !(reach < kMaxReach))
        throw LimitError(fmt::format("voxel size {}: the origin ({:g}, {:g}, {:g}) is {:g} voxels "
                                     "from the world's, more than {:g}, which transforms resolve. "
                                     "Choose larger voxels, or move the model towards the origin",
                                     lattice.voxelSize, o[0], o[1], o[2], reach, kMaxReach));
    requireHalfWidth(halfWidth);
    const auto grid = openvdb::FloatGrid::create(float(halfWidth * lattice.voxelSize));
    setLattice(*grid, lattice);
    grid->setGridClass(openvdb::GRID_LEVEL_SET);
    grid->setName(name);
    return LevelSet(grid);
}

LevelSet::LevelSet(openvdb::FloatGrid::ConstPtr grid) : mGrid(std::move(grid))
{
    if (!mGrid) throw InputError("level set: there is no grid. Read or make one first");
    requireUniformVoxels(*mGrid);
    if (mGrid->getGridClass() != openvdb::GRID_LEVEL_SET)
        throw InputError(fmt::format(
            "grid '{}': its class is {}, not a level set. Give it that class if its values are "
            "distances, negative inside; or make a level set of it with mpuvdb isosurface",
            mGrid->getName(), openvdb::GridBase::gridClassToMenuName(mGrid->getGridClass())));
    if (!(mGrid->background() > 0) || !std::isfinite(mGrid->background()))
        throw InputError(fmt::format("grid '{}': its background is {}, and a level set's is the "
                                     "half-width of its band. Write it again from its source",
                                     mGrid->getName(), mGrid->background()));
}

Box3d LevelSet::bounds() const
{
    openvdb::CoordBBox box;
    if (!mGrid->tree().evalActiveVoxelBoundingBox(box)) return {};
    const Lattice of = lattice();
    const auto world = [&](const openvdb::Coord& c) {
        return Vec3d(of.origin + of.voxelSize * Vec3d(c.x(), c.y(), c.z()));
    };
    return {world(box.min()), world(box.max())};
}

void requireFinite(const openvdb::FloatGrid& grid)
{
    using Leaf = openvdb::FloatTree::LeafNodeType;
    std::vector<const Leaf*> leaves;
    grid.tree().getNodes(leaves);
    std::vector<openvdb::Index> bad(leaves.size(), openvdb::Index(Leaf::SIZE)); // each leaf's first
    std::vector<std::uint64_t> counts(leaves.size(), 0);
    tbb::parallel_for(std::size_t(0), leaves.size(), [&](std::size_t n) {
        const float* const values = leaves[n]->buffer().data();
        for (openvdb::Index voxel = 0; voxel < Leaf::SIZE; ++voxel) {
            if (std::isfinite(values[voxel])) continue;
            bad[n] = std::min(bad[n], voxel);
            ++counts[n];
        }
    });
    const auto count = std::accumulate(counts.begin(), counts.end(), std::uint64_t(0));
    if (count == 0) return requireFiniteTiles(grid);
    const auto n = std::size_t(
        std::find_if(counts.begin(), counts.end(), [](std::uint64_t c) { return c > 0; }) -
        counts.begin());
    const openvdb::Coord at = leaves[n]->offsetToGlobalCoord(bad[n]);
    throw InputError(fmt::format("grid '{}': {} values are not finite (first at voxel {}, {}, {}). "
                                 "Write it again from its source",
                                 grid.getName(), count, at.x(), at.y(), at.z()));
}

LevelSet::LevelSet(openvdb::FloatGrid::ConstPtr grid, std::shared_ptr<const Explained> explained)
    : LevelSet(std::move(grid))
{
    mExplained = std::move(explained);
}

double LevelSet::voxelSize() const
{
    return lattice().voxelSize;
}

double LevelSet::halfWidth() const
{
    return mGrid->background() / voxelSize();
}

Lattice LevelSet::lattice() const
{
    return *latticeOf(mGrid->transform());
}

void requireVoxelSize(double voxelSize)
{
    /// Smallest voxel size, world units. [derived: cube root of the determinant 3e-15, at which
    /// OpenVDB takes a transform for singular]
    constexpr double kMinVoxelSize = 1.5e-5;
    /// Largest voxel size, world units. [derived: floats hold the square of a length of 18 voxels]
    constexpr double kMaxVoxelSize = 1e18;
    if (!(voxelSize > 0) || !std::isfinite(voxelSize))
        throw UsageError(
            fmt::format("voxel size {}: must be a positive number of world units", voxelSize));
    if (voxelSize < kMinVoxelSize)
        throw LimitError(fmt::format("voxel size {:.3g}: below {} OpenVDB takes a transform for "
                                     "singular. Scale the model, for example from meters to "
                                     "millimeters, or choose larger voxels",
                                     voxelSize, kMinVoxelSize));
    if (voxelSize > kMaxVoxelSize)
        throw LimitError(fmt::format("voxel size {:.3g}: above {:g} floats do not hold the squares "
                                     "of lengths. Scale the model, for example from meters to "
                                     "kilometers",
                                     voxelSize, kMaxVoxelSize));
}

Lattice latticeFor(const Box3d& bounds, double voxelSize)
{
    requireVoxelSize(voxelSize);
    if (bounds.isEmpty() || !bounds.min().allFinite() || !bounds.max().allFinite())
        throw InputError("bounding box: is empty or not finite, so that no grid can be laid about "
                         "it. Give at least one point");
    /// Index up to which the lattice stays at the world's origin, voxels: floats there resolve an
    /// eighth of a voxel. [derived: 24 significant bits]
    constexpr double kMaxAligned = 1 << 20;
    constexpr double kMaxHalfSize = 1 << 30; ///< half of the box, voxels [derived: range of int]
    const double extent = bounds.min().cwiseAbs().cwiseMax(bounds.max().cwiseAbs()).maxCoeff();
    const double reach = extent / voxelSize;
    if (reach < kMaxAligned) return {Vec3d::Zero(), voxelSize};
    const double halfSize = 0.5 * (bounds.max() - bounds.min()).maxCoeff() / voxelSize;
    if (!(halfSize < kMaxHalfSize && reach < kMaxReach))
        throw LimitError(fmt::format(
            "voxel size {}: the box reaches {:g} voxels from the origin and is {:g} across, more "
            "than indices and transforms resolve. Choose larger voxels, or move the model towards "
            "the origin",
            voxelSize, reach, 2 * halfSize));
    const double step = 8 * voxelSize;
    const Vec3d middle = 0.5 * bounds.min() + 0.5 * bounds.max();
    return {(middle / step).array().round().matrix() * step, voxelSize};
}

} // namespace mpuvdb
