#include <mpuvdb/level_set.h>
#include <mpuvdb/progress.h>

#include <fmt/format.h>
#include <openvdb/tree/LeafManager.h>

#include <charconv>
#include <cmath>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using openvdb::FloatGrid;
using openvdb::FloatTree;

constexpr const char* kSpacingKey = "mpuvdb:spacing";

/// The direction of the distance's gradient, from those neighbours that are in the band.
Vec3d directionAt(const FloatGrid::ConstAccessor& band, const Coord& at, double value)
{
    Vec3d gradient;
    for (int axis = 0; axis < 3; ++axis) {
        double ends[2] = {value, value};
        int steps = 0;
        for (const int side : {0, 1}) {
            Coord next = at;
            next[axis] += 2 * side - 1;
            float v = 0;
            if (!band.probeValue(next, v)) continue;
            ends[side] = double(v);
            ++steps;
        }
        gradient[axis] = steps ? (ends[1] - ends[0]) / steps : 0;
    }
    const double length = gradient.norm();
    return length > 0 ? Vec3d(gradient / length) : Vec3d(Vec3d::Zero());
}

} // namespace

FloatGrid::Ptr sampleCoverage(const LevelSet& levelSet, const Coverage& coverage,
                              Progress& progress)
{
    const FloatGrid& surface = levelSet.grid();
    const Lattice lattice = levelSet.lattice();
    auto tree = std::make_shared<FloatTree>(surface.tree(), 0.0f, openvdb::TopologyCopy());
    openvdb::tree::LeafManager<FloatTree> leaves(*tree);
    progress.beginStage("coverage", double(leaves.leafCount()));
    leaves.foreach (
        [&](FloatTree::LeafNodeType& leaf, std::size_t) {
            const FloatGrid::ConstAccessor band = surface.getConstAccessor();
            std::vector<SurfacePlace> places;
            std::vector<float> values;
            for (auto voxel = leaf.cbeginValueOn(); voxel; ++voxel) {
                const Coord at = voxel.getCoord();
                const double value = double(band.getValue(at));
                const Vec3d centre =
                    lattice.origin + lattice.voxelSize * Vec3d(at[0], at[1], at[2]);
                const Vec3d normal = directionAt(band, at, value);
                places.push_back({centre - value * normal, normal});
            }
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
    double spacing = 0;
    if (noted) {
        const std::string& text = noted->value();
        std::from_chars(text.data(), text.data() + text.size(), spacing);
    }
    return std::isfinite(spacing) ? std::max(spacing, voxel) : voxel;
}

} // namespace mpuvdb
