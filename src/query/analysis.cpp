#include "core/parallel_each.h"
#include "modelling/solid_measures.h"
#include "modelling/thickness.h"
#include "signed_triangles.h"
#include "spatial/kd_tree.h"
#include <mpuvdb/analysis.h>
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/queries.h>

#include <openvdb/tools/GridOperators.h>
#include <openvdb/tools/Interpolation.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using Leaf = openvdb::FloatTree::LeafNodeType;

/// Places of a task that follow each other. [free: grain size]
constexpr std::size_t kRun = 1024;

/// The active voxels of a band, leaf by leaf, and their nearest places on the surface.
struct Band {
    std::vector<const Leaf*> leaves;
    std::vector<std::size_t> first; ///< of each leaf's voxels, and the end
    std::vector<Vec3d> feet;        ///< world units
    std::vector<Vec3d> gradients;   ///< unit

    Band(const LevelSet& levelSet, Interrupter& progress)
    {
        levelSet.grid().tree().getNodes(leaves);
        first.push_back(0);
        for (const Leaf* leaf : leaves) first.push_back(first.back() + leaf->onVoxelCount());
        feet.resize(first.back());
        gradients.resize(first.back());
        forEachVoxel(progress, [&](std::size_t n, const Coord& at) {
            feet[n] = vecOf(levelSet.grid().indexToWorld(at));
        });
        std::vector<double> distances(feet.size());
        Queries(levelSet).distances(feet, distances.data(), gradients.data(), &progress);
        forEachParallel(feet.size(), kRun, progress,
                        [&](std::size_t n) { feet[n] -= distances[n] * gradients[n]; });
    }

    /// Call f(n, at) for voxel @a at, the @a n-th.
    template <class F>
    void forEachVoxel(Interrupter& progress, const F& f) const
    {
        forEachParallel(leaves.size(), 1, progress, [&](std::size_t leaf) {
            std::size_t n = first[leaf];
            for (auto voxel = leaves[leaf]->cbeginValueOn(); voxel; ++voxel)
                f(n++, voxel.getCoord());
        });
    }

    static Vec3d vecOf(const openvdb::Vec3d& v) { return {v[0], v[1], v[2]}; }

    /// The grid whose value at the n-th voxel is @a values(n).
    template <class GridType, class Values>
    typename GridType::ConstPtr gridOf(const LevelSet& levelSet, const std::string& name,
                                       const Values& values, Interrupter& progress) const
    {
        using Tree = typename GridType::TreeType;
        using Value = typename GridType::ValueType;
        auto tree = std::make_shared<Tree>(levelSet.grid().tree(), openvdb::zeroVal<Value>(),
                                           openvdb::TopologyCopy());
        std::vector<typename Tree::LeafNodeType*> made;
        tree->getNodes(made);
        forEachParallel(made.size(), 1, progress, [&](std::size_t leaf) {
            std::size_t n = first[leaf];
            for (auto voxel = made[leaf]->beginValueOn(); voxel; ++voxel)
                voxel.setValue(Value(values(n++)));
        });
        auto grid = GridType::create(tree);
        grid->setTransform(levelSet.grid().transform().copy());
        grid->setName(name);
        return grid;
    }
};

/// Mean curvature at places on the surface, 1 / world units.
std::vector<float> curvatures(const LevelSet& levelSet, const std::vector<Vec3d>& places,
                              Interrupter& progress)
{
    const auto grid = openvdb::tools::meanCurvature(levelSet.grid(), true, &progress);
    progress.check();
    std::vector<float> values(places.size());
    tbb::parallel_for(
        tbb::blocked_range<std::size_t>(0, places.size(), kRun), [&](const auto& range) {
            progress.check();
            const openvdb::tools::GridSampler<openvdb::FloatGrid::ConstAccessor,
                                              openvdb::tools::BoxSampler>
                sampler(grid->getConstAccessor(), grid->transform());
            for (std::size_t n = range.begin(); n < range.end(); ++n)
                values[n] = sampler.wsSample({places[n][0], places[n][1], places[n][2]});
        });
    return values;
}

} // namespace

openvdb::GridCPtrVec analyze(const LevelSet& levelSet, const AnalyzeSettings& settings,
                             Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    progress.beginStage("nearest places");
    const Band band(levelSet, progress);
    openvdb::GridCPtrVec grids;
    if (settings.normals) {
        const auto normals = [&](std::size_t n) {
            const Vec3d& g = band.gradients[n];
            return openvdb::Vec3f(float(g[0]), float(g[1]), float(g[2]));
        };
        grids.push_back(band.gridOf<openvdb::Vec3SGrid>(levelSet, "normals", normals, progress));
    }
    const auto addFloats = [&](const char* name, const std::vector<float>& values) {
        grids.push_back(band.gridOf<openvdb::FloatGrid>(
            levelSet, name, [&](std::size_t n) { return values[n]; }, progress));
    };
    if (settings.curvature) {
        progress.beginStage("curvature");
        addFloats("curvature", curvatures(levelSet, band.feet, progress));
    }
    if (settings.thickness) {
        progress.beginStage("thickness");
        const LevelSet measured = measurable(levelSet, progress);
        const std::uint64_t crossings = integrateSurface(measured, progress).crossings;
        addFloats("thickness", thicknessAt(measured, crossings, band.feet, progress));
    }
    progress.endStage();
    return grids;
}

std::vector<float> deviation(const Mesh& mesh, const Mesh& reference, Interrupter* interrupter)
{
    if (reference.triangles.empty())
        throw UsageError("deviation: the reference has no triangles. Give a mesh");
    Interrupter& progress = orSilent(interrupter);
    float size = 0; // of the coordinates
    for (const Vec3f& p : reference.positions) size = std::max(size, p.cwiseAbs().maxCoeff());
    /// Part of the coordinates' size by which equal distances differ. [derived: roundings of
    /// doubles, thousandfold]
    constexpr double kSame = 1e-12;
    const SignedTriangles triangles(reference, kSame * double(size), progress);
    std::vector<float> deviations(mesh.positions.size());
    tbb::parallel_for(std::size_t(0), (deviations.size() + kRun - 1) / kRun, [&](std::size_t run) {
        progress.check();
        const std::size_t end = std::min((run + 1) * kRun, deviations.size());
        SignedTriangles::Hint hint;
        for (std::size_t v = run * kRun; v < end; ++v) {
            const Vec3d p = mesh.world(v);
            const SignedTriangles::Near near = triangles.nearest(p, hint);
            deviations[v] = float(triangles.isBehind(p, near) ? -near.distance : near.distance);
        }
    });
    return deviations;
}

std::vector<float> deviation(const Mesh& mesh, const PointCloud& reference,
                             Interrupter* interrupter)
{
    if (reference.empty()) throw UsageError("deviation: there are no points. Give at least one");
    const KdTree tree(reference.positions);
    std::vector<float> deviations(mesh.positions.size());
    forEachParallel(deviations.size(), kRun, orSilent(interrupter), [&](std::size_t v) {
        std::vector<std::uint32_t> nearest(1);
        std::vector<float> squared(1);
        tree.nearest((mesh.world(v) - reference.frame).cast<float>(), nearest, squared);
        deviations[v] = std::sqrt(squared.front());
    });
    return deviations;
}

} // namespace mpuvdb
