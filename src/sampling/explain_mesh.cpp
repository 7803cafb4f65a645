#include "explain_mesh.h"

#include "core/even_places.h"
#include "count_parts.h"
#include "solid_blocks.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

/// Places at which the boundary is looked at. [derived: a share of one in a hundred is then known
/// to a seventh of itself]
constexpr std::size_t kPlaces = 4096;
/// Share of the boundary that may be missed: edges and corners between voxels. [derived: below what
/// a part of the boundary that somebody would look for has]
constexpr double kMissed = 0.01;
/// Voxels: whose distance is less are on the surface. [derived: what triangles are apart that
/// touch]
constexpr double kOn = 1e-3;

/// The part of a ball's volume that linear values between voxels may take, four voxels across.
/// [derived: (|k| + |l|) h^2 / 8 over its surface, by its volume, at a radius of 2 h]
constexpr double kOfSmallBall = 3.0 / 16;

/// Those of @a places around which all voxels are on one side; voxels on the surface are on both.
std::vector<TrianglePlace> missed(const std::vector<TrianglePlace>& places,
                                  const PlacedTriangles& triangles, const LevelSet& levelSet,
                                  Interrupter& progress)
{
    const auto on = float(kOn * levelSet.voxelSize());
    std::vector<std::uint8_t> isMissed(places.size());
    tbb::parallel_for(
        tbb::blocked_range<std::size_t>(0, places.size(), 256), [&](const auto& range) {
            progress.check();
            const auto at = levelSet.grid().getConstAccessor();
            for (std::size_t n = range.begin(); n < range.end(); ++n) {
                const Vec3d x = (places[n].position - triangles.shift) / triangles.voxelSize;
                const auto first = openvdb::Coord::floor(openvdb::Vec3d(x[0], x[1], x[2]));
                bool inside = false, outside = false;
                for (int corner = 0; corner < 8; ++corner) {
                    const float value =
                        at.getValue(first.offsetBy(corner & 1, corner >> 1 & 1, corner >> 2 & 1));
                    inside = inside || value < on;
                    outside = outside || value > -on;
                }
                isMissed[n] = !(inside && outside);
            }
        });
    std::vector<TrianglePlace> result;
    for (std::size_t n = 0; n < places.size(); ++n)
        if (isMissed[n]) result.push_back(places[n]);
    return result;
}

/// World units: the thickness of the wall that most of @a places are on, to a factor of two; up to
/// two voxels.
double thicknessAt(const std::vector<TrianglePlace>& places, const SolidBoundary& solid,
                   double voxelSize)
{
    constexpr std::size_t kAsked = 32;
    constexpr int kHalvings = 8;
    std::vector<double> found;
    const std::size_t stride = places.size() / kAsked + 1;
    for (std::size_t n = 0; n < places.size(); n += stride) {
        double depth = voxelSize;
        for (int k = 0; k < kHalvings; ++k, depth /= 2)
            if (solid.isInside(places[n].position - depth * places[n].normal)) break;
        found.push_back(depth);
    }
    if (found.empty()) return 2 * voxelSize;
    const auto middle = found.begin() + std::ptrdiff_t(found.size() / 4);
    std::nth_element(found.begin(), middle, found.end());
    return *middle;
}

/// @param lost  those of @a places that are missed.
void judge(MeshExplained& e, const std::vector<TrianglePlace>& places,
           const std::vector<TrianglePlace>& lost, const SolidBoundary& solid, double h)
{
    const bool volumeDiffers = std::abs(e.volumeOut - e.volumeIn) > e.volumeExplained;
    // How many parts those that meet make depends on how they do.
    const bool isSplintered = !solid.report().isCut && e.partsOut > e.partsIn;
    if (volumeDiffers || isSplintered || e.missed > kMissed)
        e.findings.push_back(fmt::format(
            "walls, gaps or details of the mesh are too thin for voxels of {:.4g}: its volume of "
            "{:.6g} in {} parts became {:.6g} in {}, and {:.1f} % of its surface is missed. Voxels "
            "of {:.3g} would show them",
            h, e.volumeIn, e.partsIn, e.volumeOut, e.partsOut, 100 * e.missed,
            thicknessAt(lost.empty() ? places : lost, solid, h) / 2));
    if (e.areaOfNothing > kMissed * e.areaIn)
        e.findings.push_back(fmt::format(
            "parts of the mesh with an area of {:.4g} ({:.0f} % of its surface) enclose nothing: "
            "they face inward and lie in no other part, or have no inside. Turn or close them",
            e.areaOfNothing, 100 * e.areaOfNothing / e.areaIn));
}

} // namespace

MeshExplained explainMesh(const SolidBoundary& solid, const PlacedTriangles& triangles,
                          const LevelSet& levelSet, Interrupter& progress)
{
    const SolidBoundary::Report& in = solid.report();
    const SolidBlocks blocks(levelSet, progress);
    const double h = levelSet.voxelSize();
    MeshExplained e;
    e.volumeIn = in.volume;
    e.areaIn = in.area;
    e.partsIn = in.parts;
    e.cavitiesIn = in.cavities;
    e.openEdges = in.openEdges;
    e.turned = in.turned;
    e.insideOut = in.insideOut;
    e.areaWithin = in.areaWithin;
    e.areaOfNothing = in.areaOfNothing;
    e.volumeOut = blocks.sums().volume;
    e.areaOut = blocks.sums().area;
    const PartCounts counts = countParts(blocks, progress);
    e.partsOut = counts.parts;
    e.cavitiesOut = counts.cavities;
    e.volumeExplained = std::min(h * h / 4 * in.bending, kOfSmallBall * in.volume);
    const auto corners = [&](std::size_t slot) {
        const TriangleTree::Corners& t = solid.tree().corners(slot);
        return std::array<Vec3d, 3>{t[0].cast<double>(), t[1].cast<double>(), t[2].cast<double>()};
    };
    const std::vector<TrianglePlace> places = placesOn(solid.tree().size(), kPlaces, corners),
                                     lost = missed(places, triangles, levelSet, progress);
    e.missed = double(lost.size()) / double(kPlaces);
    judge(e, places, lost, solid, h);
    return e;
}

} // namespace mpuvdb
