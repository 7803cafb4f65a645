#include <mpuvdb/carried_attributes.h>

#include "active_value.h"
#include "spatial/triangle_tree.h"
#include <mpuvdb/interrupter.h>
#include <mpuvdb/sampling.h>

#include <openvdb/tools/Interpolation.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace mpuvdb
{
namespace
{

using openvdb::FloatGrid;
using openvdb::Vec3SGrid;

/// The weights of a triangle's corners at its point nearest to @a p, to rounding, where that lies
/// inside; else near it.
Vec3d weightsAt(const TriangleTree::Corners& corners, const Vec3d& p)
{
    const Vec3d a = corners[0].cast<double>(), b = corners[1].cast<double>(),
                c = corners[2].cast<double>();
    const Vec3d normal = (b - a).cross(c - a);
    const double square = normal.squaredNorm();
    Vec3d weights(normal.dot((c - b).cross(p - b)), normal.dot((a - c).cross(p - c)),
                  normal.dot((b - a).cross(p - a)));
    weights = (weights / square).cwiseMax(0);
    const double sum = weights.sum();
    if (square > 0 && sum > 0 && std::isfinite(sum)) return weights / sum;
    // A triangle without an area: its nearest corner.
    const Vec3d distances((p - a).norm(), (p - b).norm(), (p - c).norm());
    Eigen::Index nearest = 0;
    distances.minCoeff(&nearest);
    return Vec3d::Unit(nearest);
}

class MeshAttributes final : public SurfaceAttributes
{
public:
    MeshAttributes(const Mesh& mesh, Interrupter& progress) : mMesh(mesh), mTree(mesh, progress)
    {
        for (const NamedScalars& scalar : mesh.scalars) mNames.push_back(scalar.name);
    }

    bool hasColors() const override { return !mMesh.colors.empty(); }
    const std::vector<std::string>& scalarNames() const override { return mNames; }

    void evaluate(const std::vector<SurfacePlace>& places,
                  std::vector<float>& values) const override
    {
        values.clear();
        std::size_t slot = 0;
        for (const SurfacePlace& place : places) {
            const Vec3d p = place.position - mMesh.frame;
            mTree.squaredDistance(p, slot);
            const Vec3d weights = weightsAt(mTree.corners(slot), p);
            const Mesh::Triangle& triangle = mMesh.triangles[mTree.triangle(slot)];
            if (hasColors()) {
                Vec3d color = Vec3d::Zero();
                for (int k = 0; k < 3; ++k)
                    color += weights[k] * mMesh.colors[triangle[std::size_t(k)]].cast<double>();
                for (int k = 0; k < 3; ++k) values.push_back(float(color[k]));
            }
            for (const NamedScalars& scalar : mMesh.scalars) {
                double sum = 0;
                for (int k = 0; k < 3; ++k)
                    sum += weights[k] * double(scalar.values[triangle[std::size_t(k)]]);
                values.push_back(float(sum));
            }
        }
    }

private:
    const Mesh& mMesh;
    TriangleTree mTree;
    std::vector<std::string> mNames;
};

/// An operand's distances and attributes, by the channels of the result.
struct Source {
    LevelSet levelSet;
    Vec3SGrid::ConstPtr colors;               ///< null: it has none
    std::vector<FloatGrid::ConstPtr> scalars; ///< null: it has none of that name
};

/// Reads a source at one place after the other, for one thread.
class SourceReader
{
public:
    explicit SourceReader(const Source& source)
        : mSource(source), mDistances(source.levelSet.grid().getConstAccessor())
    {
    }

    /// The magnitude of the distance, world units; beyond the band that of its border.
    double distance(const openvdb::Vec3d& world) const
    {
        const openvdb::Vec3d at = mSource.levelSet.grid().worldToIndex(world);
        return std::abs(double(openvdb::tools::BoxSampler::sample(mDistances, at)));
    }

    void append(const openvdb::Vec3d& world, bool withColors, std::vector<float>& values) const
    {
        if (withColors) {
            // White is the color of what has none.
            const openvdb::Vec3s color =
                mSource.colors ? valueAt(*mSource.colors, world) : openvdb::Vec3s(1);
            values.insert(values.end(), {color[0], color[1], color[2]});
        }
        for (const FloatGrid::ConstPtr& scalar : mSource.scalars)
            values.push_back(scalar ? valueAt(*scalar, world) : 0);
    }

private:
    template <class Grid>
    static typename Grid::ValueType valueAt(const Grid& grid, const openvdb::Vec3d& world)
    {
        return activeValue(grid.getConstUnsafeAccessor(), grid.worldToIndex(world));
    }

    const Source& mSource;
    FloatGrid::ConstAccessor mDistances;
};

class OperandAttributes final : public SurfaceAttributes
{
public:
    explicit OperandAttributes(const std::vector<Operand>& operands)
    {
        for (const Operand& operand : operands)
            for (const openvdb::GridBase::ConstPtr& grid : operand.grids)
                addName(*grid, operand.levelSet);
        for (const Operand& operand : operands) {
            Source source{operand.levelSet, nullptr,
                          std::vector<FloatGrid::ConstPtr>(mNames.size())};
            for (const openvdb::GridBase::ConstPtr& grid : operand.grids) place(grid, source);
            mSources.push_back(std::move(source));
        }
    }

    bool hasColors() const override { return mHasColors; }
    const std::vector<std::string>& scalarNames() const override { return mNames; }

    void evaluate(const std::vector<SurfacePlace>& places,
                  std::vector<float>& values) const override
    {
        values.clear();
        const std::vector<SourceReader> readers(mSources.begin(), mSources.end());
        for (const SurfacePlace& place : places) {
            const openvdb::Vec3d world(place.position.x(), place.position.y(), place.position.z());
            const auto nearest = std::min_element(
                readers.begin(), readers.end(), [&](const SourceReader& a, const SourceReader& b) {
                    return a.distance(world) < b.distance(world);
                });
            nearest->append(world, mHasColors, values);
        }
    }

private:
    /// Whether @a grid lies on the voxels of the band, as attributes do; volumes do not.
    static bool isScalar(const openvdb::GridBase& grid, const LevelSet& levelSet)
    {
        return grid.isType<FloatGrid>() && grid.getGridClass() == openvdb::GRID_UNKNOWN &&
               grid.getName() != kCoverageName && grid.transform() == levelSet.grid().transform() &&
               grid.activeVoxelCount() == levelSet.grid().activeVoxelCount();
    }

    static bool isColors(const openvdb::GridBase& grid)
    {
        return grid.isType<Vec3SGrid>() && grid.getName() == kColorName &&
               grid.transform().isLinear();
    }

    void addName(const openvdb::GridBase& grid, const LevelSet& levelSet)
    {
        mHasColors |= isColors(grid);
        const std::string name = grid.getName();
        if (isScalar(grid, levelSet) &&
            std::find(mNames.begin(), mNames.end(), name) == mNames.end())
            mNames.push_back(name);
    }

    void place(const openvdb::GridBase::ConstPtr& grid, Source& source) const
    {
        if (isColors(*grid)) source.colors = openvdb::gridConstPtrCast<Vec3SGrid>(grid);
        if (!isScalar(*grid, source.levelSet)) return;
        const auto at = std::find(mNames.begin(), mNames.end(), grid->getName());
        source.scalars[std::size_t(at - mNames.begin())] =
            openvdb::gridConstPtrCast<FloatGrid>(grid);
    }

    std::vector<Source> mSources;
    bool mHasColors = false;
    std::vector<std::string> mNames;
};

class CutCoverage final : public Coverage
{
public:
    CutCoverage(const LevelSet& solid, const LevelSet& tool, FloatGrid::ConstPtr coverage)
        : mSolid{solid, {}, {std::move(coverage)}}, mTool{tool, {}, {}}
    {
    }

    void evaluate(const std::vector<SurfacePlace>& places,
                  std::vector<float>& values) const override
    {
        const SourceReader solid(mSolid), tool(mTool);
        const double h = mSolid.levelSet.voxelSize();
        std::vector<float> own;
        values.clear();
        for (const SurfacePlace& place : places) {
            const openvdb::Vec3d at(place.position[0], place.position[1], place.position[2]);
            // Of the two surfaces the nearer one is that of the place.
            const double nearer = (tool.distance(at) - solid.distance(at)) / (2 * h);
            own.assign(1, 1);
            if (mSolid.scalars.front()) {
                own.clear();
                solid.append(at, false, own);
            }
            values.push_back(own.front() * float(std::clamp(0.5 + nearer, 0.0, 1.0)));
        }
    }
    double spacing() const override
    {
        return mSolid.scalars.front() ? coverageScale(*mSolid.scalars.front()) : 0;
    }

private:
    Source mSolid, mTool;
};

} // namespace

std::unique_ptr<SurfaceAttributes> attributesOfMesh(const Mesh& mesh, Interrupter* interrupter)
{
    return std::make_unique<MeshAttributes>(mesh, orSilent(interrupter));
}

std::unique_ptr<SurfaceAttributes> attributesOfOperands(const std::vector<Operand>& operands)
{
    return std::make_unique<OperandAttributes>(operands);
}

std::unique_ptr<Coverage> coverageOfCut(const LevelSet& solid, const LevelSet& tool,
                                        FloatGrid::ConstPtr coverage)
{
    return std::make_unique<CutCoverage>(solid, tool, std::move(coverage));
}

} // namespace mpuvdb
