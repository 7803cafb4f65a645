#include "tiles.h"

#include "field/near_zero.h"
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <tbb/parallel_for.h>
#include <tuple>

namespace mpuvdb
{
namespace
{

/// Distance beyond the points' box that fills reach, in its extents. [derived: the coarse field is
/// outside from a fifth of the extent on]
constexpr double kFillReach = 0.25;
/// Voxels beside a tile whose points count: their band may enter it. [derived: a block, beside the
/// band]
constexpr double kBeside = 8;
/// Edge of the cubes, voxels, that are not divided further: the tile is sampled. [derived: a block,
/// by whose middle a region's band is searched where there are no data]
constexpr double kSmallCube = kBlockDim;

/// Whether the zero set of @a field may come within @a band (world units) of a cube.
bool mayMeet(const Field& field, const Vec3d& center, double edge, double band, double smallest)
{
    if (!mayComeNear(field.evaluate(center), edge, band)) return false;
    if (edge <= smallest) return true;
    for (int octant = 0; octant < 8; ++octant) {
        const Vec3d side(octant & 1 ? 1 : -1, octant & 2 ? 1 : -1, octant & 4 ? 1 : -1);
        if (mayMeet(field, center + edge / 4 * side, edge / 2, band, smallest)) return true;
    }
    return false;
}

/// Whether @a field is inside somewhere on a face of @a box.
bool isInsideOn(const Field& field, const Box3d& box, int axis, bool upper)
{
    constexpr int kPlaces = 16; ///< along each side of the face [free: time]
    for (int i = 0; i < kPlaces; ++i)
        for (int j = 0; j < kPlaces; ++j) {
            Vec3d part; // of the box
            part[axis] = upper;
            part[(axis + 1) % 3] = (i + 0.5) / kPlaces;
            part[(axis + 2) % 3] = (j + 0.5) / kPlaces;
            if (field.evaluate(box.min() + part.cwiseProduct(box.sizes())).value < 0) return true;
        }
    return false;
}

/// @throws InputError if @a field is inside beyond all sides of the points: it would have to be
/// ended somewhere, which no tile can know.
void requireEnd(const MpuField& field)
{
    /// How far about the points' box, in its extents, the field is looked at. [derived: a quarter
    /// of the way to where the coarse field ends]
    constexpr double kBesidePoints = 0.05;
    const Box3d bounds = field.bounds();
    const Vec3d beside = Vec3d::Constant(kBesidePoints * bounds.sizes().maxCoeff());
    const Box3d box(bounds.min() - beside, bounds.max() + beside);
    for (int face = 0; face < 6; ++face)
        if (!isInsideOn(field, box, face / 2, face % 2 != 0)) return;
    throw InputError("the solid is all about the points and has no end, as their normals point "
                     "inward, so that tiles of it do not fit together. Turn the normals round "
                     "(with or without --flip-normals), or reconstruct it at once");
}

} // namespace

std::vector<Tile> tilesOf(const MpuField& field, const SampleSettings& settings, int edge,
                          Interrupter& progress)
{
    requireEnd(field);
    const Lattice& lattice = settings.lattice;
    const double h = lattice.voxelSize, band = settings.halfWidth * h;
    const Box3d bounds = field.bounds();
    const Vec3d beyond =
        Vec3d::Constant(kFillReach * bounds.sizes().maxCoeff() + band + kBeside * h);
    const auto tileAt = [&](const Vec3d& p) {
        const Vec3d at = ((p - lattice.origin) / (h * edge)).array().floor();
        return Vec3i(at.cast<int>());
    };
    const Vec3i first = tileAt(bounds.min() - beyond), last = tileAt(bounds.max() + beyond);
    const Vec3i count = last - first + Vec3i::Ones();
    std::vector<std::vector<Tile>> rows(std::size_t(count[0]) * std::size_t(count[1]));
    tbb::parallel_for(std::size_t(0), rows.size(), [&](std::size_t row) {
        for (int k = 0; k < count[2]; ++k) {
            progress.check();
            const Vec3i at = first + Vec3i(int(row) / count[1], int(row) % count[1], k);
            const openvdb::Coord low(at[0] * edge, at[1] * edge, at[2] * edge);
            Tile tile{openvdb::CoordBBox::createCube(low, edge)};
            const Vec3d corner =
                lattice.origin + h * ((edge * at).cast<double>() - Vec3d::Constant(0.5));
            const Box3d box(corner, corner + Vec3d::Constant(h * edge));
            const Vec3d wider = Vec3d::Constant(band + kBeside * h);
            const auto all = std::numeric_limits<std::size_t>::max();
            tile.points = field.countData(box, all);
            if (field.countData({box.min() - wider, box.max() + wider}, 1) > 0 ||
                mayMeet(field, box.center(), h * edge, band, h * kSmallCube))
                rows[row].push_back(tile);
        }
    });
    std::vector<Tile> tiles;
    for (const auto& row : rows) tiles.insert(tiles.end(), row.begin(), row.end());
    std::stable_sort(tiles.begin(), tiles.end(),
                     [](const Tile& a, const Tile& b) { return a.points > b.points; });
    return tiles;
}

} // namespace mpuvdb
