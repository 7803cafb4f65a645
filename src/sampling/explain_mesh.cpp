#include "explain_mesh.h"

#include "core/even_places.h"
#include "count_parts.h"
#include "solid_blocks.h"
#include "surface/octant_plane.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

/// Number of sampled places on the boundary. [derived: a share of 1 % has a standard error of a
/// seventh]
constexpr std::size_t kPlaces = 4096;
/// Largest share of the boundary that may be missed: edges and corners between voxels.
/// [tuned: explained_test]
constexpr double kMaxMissed = 0.01;

/// Places of a mesh in a level set's grid, and whether the surface is there.
class PlacesInGrid
{
public:
    /// @param shift  of the mesh. @param hasWalls  that may bury the surface.
    PlacesInGrid(const LevelSet& levelSet, const Vec3d& shift, bool hasWalls)
        : mAt(levelSet.grid().getConstAccessor()), mVoxelSize(levelSet.voxelSize()), mShift(shift),
          mHasWalls(hasWalls)
    {
    }

    bool misses(const TrianglePlace& place) const
    {
        const Vec3d x = (place.position - mShift) / mVoxelSize;
        return !isBetweenVoxels(x) || isInHole(x, place.normal);
    }

private:
    /// Whether the voxels about @a x are on both sides, or, where walls may bury the surface,
    /// inside; voxels on the surface are on both.
    bool isBetweenVoxels(const Vec3d& x) const
    {
        const auto on = float(kTouch * mVoxelSize);
        const auto first = openvdb::Coord::floor(openvdb::Vec3d(x[0], x[1], x[2]));
        bool inside = false, outside = mHasWalls;
        for (int corner = 0; corner < 8; ++corner) {
            const float value =
                mAt.getValue(first.offsetBy(corner & 1, corner >> 1 & 1, corner >> 2 & 1));
            inside = inside || value < on;
            outside = outside || value > -on;
        }
        return inside && outside;
    }

    /// Whether the surface at @a x is missed by the nearest line of voxels along its normal: the
    /// two between which it passes are both outside of a wall, or inside of a gap's sides.
    bool isInHole(const Vec3d& x, const Vec3d& normal) const
    {
        // The cosine between normals below which they are those of a wall's or gap's sides.
        // [derived: of a wedge, whose normals' is (1/16 - 1) / (1/16 + 1) at most, more than two
        // voxels are thinner than one]
        constexpr float kOpposed = -15.0f / 17;
        Eigen::Index axis = 0;
        normal.cwiseAbs().maxCoeff(&axis);
        Vec3d line = x.array().round();
        line[axis] = x[axis];
        line[axis] -= normal.dot(line - x) / normal[axis];
        auto low = openvdb::Coord::floor(openvdb::Vec3d(line[0], line[1], line[2]));
        openvdb::Coord high = low;
        ++high[int(axis)];
        const float a = mAt.getValue(low), b = mAt.getValue(high);
        if (a * b <= 0) return false;
        const auto scale = float(1 / mVoxelSize);
        const OctantPlane below = octantPlaneAt(mAt, low, scale),
                          above = octantPlaneAt(mAt, high, scale);
        return below.weight() > 0 && above.weight() > 0 &&
               below.normal.dot(above.normal) < kOpposed;
    }

    openvdb::FloatGrid::ConstAccessor mAt;
    double mVoxelSize;
    Vec3d mShift;
    bool mHasWalls;
};

/// The places that the level set's surface misses.
std::vector<TrianglePlace> missedPlaces(const std::vector<TrianglePlace>& places,
                                        const Vec3d& shift, const LevelSet& levelSet, bool hasWalls,
                                        Interrupter& progress)
{
    std::vector<std::uint8_t> isMissed(places.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, places.size(), 256),
                      [&](const auto& range) {
                          progress.check();
                          const PlacesInGrid grid(levelSet, shift, hasWalls);
                          for (std::size_t n = range.begin(); n < range.end(); ++n)
                              isMissed[n] = grid.misses(places[n]);
                      });
    std::vector<TrianglePlace> result;
    for (std::size_t n = 0; n < places.size(); ++n)
        if (isMissed[n]) result.push_back(places[n]);
    return result;
}

/// Thickness of the wall or the gap at a place, to a factor of two, world units; at most a voxel.
double thicknessAt(const TrianglePlace& place, const SolidBoundary& solid, double voxelSize)
{
    constexpr int kHalvings = 8; ///< of a voxel at most [tuned: explained_test]
    double depth = voxelSize;
    for (int k = 0; k < kHalvings; ++k, depth /= 2)
        if (solid.isInside(place.position - depth * place.normal) &&
            !solid.isInside(place.position + depth * place.normal))
            break;
    return depth;
}

/// Thickness of walls and gaps that voxels miss: the lower quartile of those at the places that are
/// @a missed, else what a hundredth of all @a places is thinner than: beside an edge, places are
/// as near to another face as one likes. World units.
double missedThickness(const std::vector<TrianglePlace>& places,
                       const std::vector<TrianglePlace>& missed, const SolidBoundary& solid,
                       double voxelSize)
{
    constexpr std::size_t kMaxPlaces = 256; ///< [free: time, where something is found]
    const std::vector<TrianglePlace>& some = missed.empty() ? places : missed;
    std::vector<double> found;
    for (std::size_t n = 0; n < some.size(); n += some.size() / kMaxPlaces + 1)
        found.push_back(thicknessAt(some[n], solid, voxelSize));
    if (found.empty()) return voxelSize; // triangles without area have no places
    const double share = missed.empty() ? kMaxMissed : 0.25;
    const auto at = found.begin() + std::ptrdiff_t(share * double(found.size()));
    std::nth_element(found.begin(), at, found.end());
    return *at;
}

/// Add findings to @a e. @param missed  the places that are missed.
void addFindings(MeshExplained& e, const std::vector<TrianglePlace>& places,
                 const std::vector<TrianglePlace>& missed, const SolidBoundary& solid, double h)
{
    // Walls made of sheets are in the result only.
    const bool isMesh = solid.sheets() == nullptr;
    const bool volumeDiffers = isMesh && !solid.report().isClosedAnew &&
                               std::abs(e.volumeOut - e.volumeIn) > e.volumeExplained;
    // Parts that meet are counted as one, and may be more.
    const bool isSplintered = isMesh && !solid.report().isCut && e.partsOut > e.partsIn;
    const bool someAreLost = isMesh && !solid.report().isClosedAnew &&
                             (e.partsOut < e.partsIn || e.cavitiesOut < e.cavitiesIn);
    if (volumeDiffers || isSplintered || someAreLost || e.missed > kMaxMissed)
        e.findings.push_back(fmt::format(
            "walls, gaps, parts or cavities of the mesh are too thin for voxels of {:.4g}: its "
            "volume of {:.6g} in {} parts with {} cavities became {:.6g} in {} with {}, and "
            "{:.1f} % of its surface is missed. Voxels of {:.3g} would show them",
            h, e.volumeIn, e.partsIn, e.cavitiesIn, e.volumeOut, e.partsOut, e.cavitiesOut,
            100 * e.missed, missedThickness(places, missed, solid, h) / 2));
    const double area = e.areaIn + e.areaWithin + e.areaOfNothing; // of the mesh
    if (e.areaOfNothing > kMaxMissed * area)
        e.findings.push_back(fmt::format(
            "parts of the mesh with an area of {:.4g} ({:.0f} % of its surface) enclose nothing: "
            "they face inward and lie in no other part, or have no inside. Turn or close them, or "
            "repair the mesh (--repair turns and closes, --thicken LENGTH makes walls of open "
            "surfaces)",
            e.areaOfNothing, 100 * e.areaOfNothing / area));
}

} // namespace

MeshExplained explainMesh(const SolidBoundary& solid, const Vec3d& shift, const LevelSet& levelSet,
                          Interrupter& progress)
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
    const PartCounts counts = countParts(levelSet, blocks, progress);
    e.partsOut = counts.parts;
    e.cavitiesOut = counts.cavities;
    e.volumeExplained =
        std::min(h * h / 4 * in.bending, kSmallBallShare * in.volume) + std::abs(in.volumeOfHoles);
    const auto corners = [&](std::size_t slot) {
        const TriangleTree::Corners& t = solid.tree().corners(slot);
        return std::array<Vec3d, 3>{t[0].cast<double>(), t[1].cast<double>(), t[2].cast<double>()};
    };
    if (solid.isEmpty()) return e; // of walls only
    const std::vector<TrianglePlace> places = placesOn(solid.tree().size(), kPlaces, corners);
    // Faces that lie on voxels are there, but bound nothing where nothing is inside.
    const std::vector<TrianglePlace> missed =
        counts.parts == 0 ? places
                          : missedPlaces(places, shift, levelSet, solid.sheets(), progress);
    e.missed = double(missed.size()) / double(kPlaces);
    addFindings(e, places, missed, solid, h);
    return e;
}

} // namespace mpuvdb
