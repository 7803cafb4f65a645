#include "explain_mesh.h"

#include "solid_parts.h"
#include "solid_sums.h"

#include <mpuvdb/progress.h>

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

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

/// A place on the boundary, with its normal; relative to the frame.
struct Place {
    Vec3d position, normal;
};

/// Places spread evenly over all triangles, in their order.
std::vector<Place> placesOn(const TriangleTree& tree)
{
    std::vector<double> upTo(tree.size());
    double area = 0;
    const auto areaVector = [&](std::size_t slot) {
        const TriangleTree::Corners& t = tree.corners(slot);
        const Vec3d a = t[0].cast<double>();
        return Vec3d((t[1].cast<double>() - a).cross(t[2].cast<double>() - a));
    };
    for (std::size_t slot = 0; slot < tree.size(); ++slot)
        upTo[slot] = area += areaVector(slot).norm();
    std::vector<Place> places;
    std::size_t slot = 0;
    for (std::size_t n = 0; n < kPlaces; ++n) {
        while (slot + 1 < tree.size() && upTo[slot] < area * (double(n) + 0.5) / kPlaces) ++slot;
        // Evenly over the triangle, too [Cranley76: multiples of two irrational numbers].
        double s = std::fmod(0.7548776662466927 * double(n), 1),
               r = std::fmod(0.5698402909980532 * double(n), 1);
        if (s + r > 1) s = 1 - s, r = 1 - r;
        const TriangleTree::Corners& t = tree.corners(slot);
        const Vec3d a = t[0].cast<double>(), b = t[1].cast<double>(), c = t[2].cast<double>();
        places.push_back({a + s * (b - a) + r * (c - a), areaVector(slot).normalized()});
    }
    return places;
}

/// Those of @a places around which all voxels are on one side; voxels on the surface are on both.
std::vector<Place> missed(const std::vector<Place>& places, const PlacedTriangles& triangles,
                          const LevelSet& levelSet, Progress& progress)
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
    std::vector<Place> result;
    for (std::size_t n = 0; n < places.size(); ++n)
        if (isMissed[n]) result.push_back(places[n]);
    return result;
}

/// World units: the thickness of the wall that most of @a places are on, to a factor of two; up to
/// two voxels.
double thicknessAt(const std::vector<Place>& places, const SolidBoundary& solid, double voxelSize)
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

/// Parts of at least two voxels along each axis' worth: a corner may hold one that is alone.
std::uint64_t countParts(const LevelSet& levelSet, Progress& progress)
{
    constexpr int kSpeck = 8; // voxels
    const SolidParts found(levelSet, progress);
    return std::uint64_t(
        std::count_if(found.parts().begin(), found.parts().end(), [](const SolidParts::Part& part) {
            int voxels = 0;
            for (const SolidParts::Piece& piece : part.pieces)
                for (const std::uint64_t word : piece.voxels) voxels += __builtin_popcountll(word);
            return !part.tiles.empty() || voxels >= kSpeck;
        }));
}

/// @param lost  those of @a places that are missed.
void judge(MeshExplained& e, const std::vector<Place>& places, const std::vector<Place>& lost,
           const SolidBoundary& solid, double h)
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
                          const LevelSet& levelSet, Progress& progress)
{
    const SolidBoundary::Report& in = solid.report();
    const SolidSums out = sumSolid(levelSet, progress);
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
    e.volumeOut = out.volume;
    e.areaOut = out.area;
    e.partsOut = countParts(levelSet, progress);
    e.volumeExplained = std::min(h * h / 4 * in.bending, kOfSmallBall * in.volume);
    const std::vector<Place> places = placesOn(solid.tree()),
                             lost = missed(places, triangles, levelSet, progress);
    e.missed = double(lost.size()) / double(kPlaces);
    judge(e, places, lost, solid, h);
    return e;
}

} // namespace mpuvdb
