#include "surface/surface_places.h"
#include <mpuvdb/interrupter.h>
#include <mpuvdb/sampling.h>

#include <charconv>
#include <cmath>
#include <fmt/format.h>
#include <openvdb/tree/LeafManager.h>

namespace mpuvdb
{
namespace
{

using openvdb::FloatGrid;
using openvdb::FloatTree;

constexpr int kProjections = 3; ///< steps of SurfacePlaces::find() [tuned: coverage_test]
constexpr const char* kSpacingKey = "mpuvdb:spacing";

} // namespace

FloatGrid::Ptr sampleCoverage(const LevelSet& levelSet, const Coverage& coverage,
                              Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    const FloatGrid& surface = levelSet.grid();
    const Lattice lattice = levelSet.lattice();
    auto tree = std::make_shared<FloatTree>(surface.tree(), 0.0f, openvdb::TopologyCopy());
    openvdb::tree::LeafManager<FloatTree> leaves(*tree);
    progress.beginStage("coverage", double(leaves.leafCount()));
    leaves.foreach (
        [&](FloatTree::LeafNodeType& leaf, std::size_t) {
            std::vector<SurfacePlace> places(leaf.onVoxelCount());
            SurfacePlaces(surface, lattice).find(leaf, kProjections, places.data());
            std::vector<float> values;
            coverage.evaluate(places, values);
            auto next = values.begin();
            for (auto voxel = leaf.beginValueOn(); voxel; ++voxel) voxel.setValue(*next++);
            progress.advance();
        },
        /*threaded=*/true, /*grainsize=*/16);
    auto grid = FloatGrid::create(tree);
    grid->setTransform(surface.transform().copy());
    grid->setGridClass(openvdb::GRID_UNKNOWN);
    grid->setName(kCoverageName);
    grid->insertMeta(
        "mpuvdb:quantity",
        openvdb::StringMetadata("1 where data support the surface, 0 where it is invented"));
    grid->insertMeta(kSpacingKey, openvdb::StringMetadata(fmt::format("{}", coverage.spacing())));
    progress.endStage();
    return grid;
}

double coverageScale(const FloatGrid& coverage)
{
    const double voxel = coverage.voxelSize()[0];
    const auto noted = coverage.getMetadata<openvdb::StringMetadata>(kSpacingKey);
    double spacing = -1; // not known
    if (noted) {
        const std::string& text = noted->value();
        std::from_chars(text.data(), text.data() + text.size(), spacing);
    }
    if (spacing == 0) return 0;
    return std::isfinite(spacing) ? std::max(spacing, voxel) : voxel;
}

} // namespace mpuvdb
