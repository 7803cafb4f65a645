// Comparison of a level set with the points that it was made from.
#include "core/clones.h"
#include "count_parts.h"
#include "max_lost.h"
#include "solid_blocks.h"
#include <mpuvdb/explained.h>
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <openvdb/tree/LeafManager.h>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

using Tree = openvdb::FloatTree;
using Leaf = Tree::LeafNodeType;
using Accessor = openvdb::tree::ValueAccessor<const Tree, /*IsSafe=*/false>;

/// Largest deviation of a point, standard deviations of the noise. [derived: 0.3 % of normal noise
/// is beyond]
constexpr double kMaxDeviations = 3;
/// Largest error of a surface in voxels, even beside edges. [derived: half the edge between two]
constexpr double kMaxVoxelError = 0.5;
/// Largest share of the points beyond the limit. [derived: erfc(1.5 / sqrt 2): beyond three
/// deviations of noise twice as large as measured]
constexpr double kMaxUnexplained = 0.1336;
/// Cosine of 60 degrees, by which a normal is off the surface's. [derived: three times the noise of
/// the worst normals that scans have]
constexpr float kOff = 0.5f;
/// Largest share of the points whose normals are off. [derived: of directions at random three
/// quarters are, which the surface follows in half of the places; half of that is left to edges]
constexpr double kMaxOff = 0.1875;
/// Largest volume between a mesh and the surface, areas times mean distances. [derived: 1 is not
/// passed where each is near the other; as much again for what the mesh has no places near]
constexpr double kMaxApart = 2;
/// Error of a surface between voxels, voxels. [derived: of values between those of a ball of four
/// voxels' radius, h^2 / 8 times the sum of its curvatures]
constexpr double kBetweenVoxels = 1.0 / 16;
/// Distance up to which points support the surface, spacings. [tuned: explained_test]
constexpr double kSupportReach = 5;

/// Values of a band at places that are near each other: it keeps the last leaf of each parity of
/// position, so that it has all leaves that the corners of a cell are in.
class BandValues
{
public:
    explicit BandValues(const Tree& band) : mBand(band) { mOrigins.fill(openvdb::Coord::max()); }

    /// The values of the eight voxels from @a base on, z fastest, @a stride apart.
    void read(const openvdb::Coord& base, float* v, std::size_t stride)
    {
        const std::size_t own = enter(base);
        const auto isWithin = [&](int axis) { return (base[axis] & kLast) != kLast; };
        if (mData[own] && isWithin(0) && isWithin(1) && isWithin(2)) {
            const float* const first = mData[own] + Leaf::coordToOffset(base);
            for (int n = 0; n < 8; ++n)
                v[std::size_t(n) * stride] = first[(n >> 2) * 64 + (n >> 1 & 1) * 8 + (n & 1)];
            return;
        }
        for (int n = 0; n < 8; ++n) {
            const openvdb::Coord at = base.offsetBy(n >> 2, n >> 1 & 1, n & 1);
            const std::size_t k = enter(at);
            v[std::size_t(n) * stride] = mData[k] ? mData[k][Leaf::coordToOffset(at)] : mTiles[k];
        }
    }
    /// Bring the leaf of @a voxel closer.
    void prefetch(const openvdb::Coord& voxel) { enter(voxel); }

private:
    static constexpr int kLast = int(Leaf::DIM) - 1; ///< of a leaf's voxels [derived: the tree]

    /// Where the leaf or tile of @a voxel is kept.
    std::size_t enter(const openvdb::Coord& voxel)
    {
        const openvdb::Coord origin = voxel & ~kLast;
        const auto parity = [&](int axis) { return std::size_t(voxel[axis] >> Leaf::LOG2DIM & 1); };
        const std::size_t k = 4 * parity(0) + 2 * parity(1) + parity(2);
        if (mOrigins[k] != origin) keep(k, origin);
        return k;
    }
    void keep(std::size_t k, const openvdb::Coord& origin)
    {
        const Leaf* const leaf = mBand.probeConstLeaf(origin);
        mOrigins[k] = origin;
        mData[k] = leaf ? leaf->buffer().data() : nullptr;
        mTiles[k] = leaf ? 0 : mBand.getValue(origin);
        if (leaf) mpuvdb::prefetch(mData[k]);
    }

    Accessor mBand;
    std::array<openvdb::Coord, 8> mOrigins;
    std::array<const float*, 8> mData{}; ///< of leaves
    std::array<float, 8> mTiles{};       ///< of tiles and the background
};

/// Places that are looked at together, for vector units.
struct Places {
    static constexpr std::size_t kSize = 64; ///< [free: time]

    std::array<float, kSize> t[3];      ///< place in its cell, voxels
    std::array<float, kSize> corner[8]; ///< values there, z fastest
    std::array<float, kSize> normal[3]; ///< unit; of points
    std::array<float, kSize> distance;  ///< of the place; as the corners' values
    std::array<float, kSize> off;       ///< 1 where the normal is off the surface's, else 0

    std::array<openvdb::Coord, kSize> base; ///< first corner

    /// Let place @a n be at @a x, voxels.
    void set(std::size_t n, const Vec3d& x, BandValues& band)
    {
        /// Beyond the voxels of any level set. [derived: the range of int, less a cell]
        constexpr double kFar = std::numeric_limits<int>::max() - 1;
        for (int axis = 0; axis < 3; ++axis) {
            const double at = std::clamp(x[axis], -kFar, kFar);
            const int towardZero = int(at); // without a call, which std::floor may be
            const int below = towardZero - int(at < towardZero);
            base[n][axis] = below;
            t[axis][n] = float(at - below);
        }
        band.prefetch(base[n]);
    }
    void read(std::size_t count, BandValues& band)
    {
        for (std::size_t n = 0; n < count; ++n) band.read(base[n], &corner[0][n], kSize);
    }
};

/// Set distances of @a places, and which normals are off.
MPUVDB_WIDE_CLONES
void measure(Places& places)
{
    const auto& v = places.corner;
    for (std::size_t n = 0; n < Places::kSize; ++n) {
        const float x = places.t[0][n], y = places.t[1][n], z = places.t[2][n];
        const float rise00 = v[1][n] - v[0][n], rise01 = v[3][n] - v[2][n],
                    rise10 = v[5][n] - v[4][n], rise11 = v[7][n] - v[6][n];
        const float z00 = v[0][n] + z * rise00, z01 = v[2][n] + z * rise01,
                    z10 = v[4][n] + z * rise10, z11 = v[6][n] + z * rise11;
        const float y0 = z00 + y * (z01 - z00), y1 = z10 + y * (z11 - z10);
        const float rise0 = rise00 + y * (rise01 - rise00), rise1 = rise10 + y * (rise11 - rise10);
        const float gx = y1 - y0, gy = z01 - z00 + x * (z11 - z10 - (z01 - z00)),
                    gz = rise0 + x * (rise1 - rise0);
        const float along =
            gx * places.normal[0][n] + gy * places.normal[1][n] + gz * places.normal[2][n];
        const float least = kOff * kOff * (gx * gx + gy * gy + gz * gz);
        places.distance[n] = std::abs(y0 + x * gx);
        places.off[n] = along < 0 || along * along < least ? 1.0f : 0.0f;
    }
}

/// Counts over some of the points.
struct Counts {
    std::uint64_t points = 0, within = 0, off = 0, beyondBand = 0;
    double largest = 0, sum = 0; ///< of the distances; those beyond the band are the band's
    Box3d box;                   ///< from the points' frame

    void add(const Places& places, std::size_t count, double limit, double background)
    {
        points += count;
        for (std::size_t n = 0; n < count; ++n) {
            const auto distance = double(places.distance[n]);
            within += distance <= limit;
            off += places.off[n] != 0;
            beyondBand += distance >= background;
            largest = std::max(largest, distance);
            sum += distance;
        }
    }
    void add(const Counts& other)
    {
        points += other.points;
        within += other.within;
        off += other.off;
        beyondBand += other.beyondBand;
        largest = std::max(largest, other.largest);
        sum += other.sum;
        box.extend(other.box);
    }
};

Counts countPoints(const LevelSet& levelSet, const MpuField& field, double limit,
                   const std::optional<Box3d>& region, Interrupter& progress)
{
    using Range = std::pair<std::size_t, std::size_t>;
    constexpr std::size_t kTogether = 4096; ///< most points of a task [free: time]
    const FieldPoints points = field.points();
    std::vector<Range> tasks;
    for (const Range& range :
         region ? field.pointsIn(*region) : std::vector<Range>{{0, points.count}})
        for (std::size_t at = range.first; at < range.second; at += kTogether)
            tasks.emplace_back(at, std::min(at + kTogether, range.second));
    const Lattice lattice = levelSet.lattice();
    const Vec3d shift = points.frame - lattice.origin;
    const double background = levelSet.grid().background(), perVoxel = 1 / lattice.voxelSize;
    std::vector<Counts> counts(tasks.size());
    tbb::parallel_for(std::size_t(0), counts.size(), [&](std::size_t n) {
        progress.check();
        BandValues band(levelSet.grid().tree());
        Places places{};
        std::size_t count = 0;
        const auto take = [&] {
            places.read(count, band);
            measure(places);
            counts[n].add(places, count, limit, background);
            count = 0;
        };
        for (std::size_t i = tasks[n].first; i < tasks[n].second; ++i) {
            const Vec3d p(points.x[i], points.y[i], points.z[i]);
            if (region && !region->contains(Vec3d(p + points.frame))) continue;
            counts[n].box.extend(p);
            places.set(count, (p + shift) * perVoxel, band);
            places.normal[0][count] = points.nx[i];
            places.normal[1][count] = points.ny[i];
            places.normal[2][count] = points.nz[i];
            if (++count == Places::kSize) take();
        }
        take();
    });
    Counts all;
    for (const Counts& some : counts) all.add(some);
    return all;
}

/// The share of the band's voxels that are in leaves without points nearby.
double unsupportedShare(const LevelSet& levelSet, const MpuField& field, Interrupter& progress)
{
    const Lattice lattice = levelSet.lattice();
    openvdb::tree::LeafManager<const Tree> leaves(levelSet.grid().tree());
    const double reach = kSupportReach * field.settings().points.spacing;
    std::vector<std::array<std::uint64_t, 2>> voxels(leaves.leafCount()); // of all, unsupported
    leaves.foreach (
        [&](const Leaf& leaf, std::size_t n) {
            progress.check();
            const openvdb::Coord& o = leaf.origin();
            const Vec3d low = lattice.origin + lattice.voxelSize * Vec3d(o.x(), o.y(), o.z()) -
                              Vec3d::Constant(reach);
            const Box3d box(low, low + Vec3d::Constant(2 * reach + Leaf::DIM * lattice.voxelSize));
            voxels[n][0] = leaf.onVoxelCount();
            if (field.countData(box, 1) == 0) voxels[n][1] = voxels[n][0];
        },
        /*threaded=*/true, /*grainsize=*/16);
    std::uint64_t all = 0, unsupported = 0;
    for (const auto& [some, bare] : voxels) {
        all += some;
        unsupported += bare;
    }
    return all ? double(unsupported) / double(all) : 0;
}

/// Counts over places of a mesh. @param limit  of the distance, world units.
Counts countPlaces(const LevelSet& levelSet, const std::vector<Vec3d>& places, double limit)
{
    const Lattice lattice = levelSet.lattice();
    BandValues band(levelSet.grid().tree());
    Places some{};
    Counts counts;
    for (std::size_t first = 0; first < places.size(); first += Places::kSize) {
        const std::size_t count = std::min(Places::kSize, places.size() - first);
        for (std::size_t n = 0; n < count; ++n)
            some.set(n, (places[first + n] - lattice.origin) / lattice.voxelSize, band);
        some.read(count, band);
        measure(some);
        counts.add(some, count, limit, levelSet.grid().background());
    }
    return counts;
}

/// Compare the surface with the mesh whose vertices the points are. @param limit  largest distance
/// of places between the points, world units. @param tolerance  of the fit, world units.
void compareWithMesh(PointsExplained& e, const LevelSet& levelSet, const VertexMesh& mesh,
                     double limit, double tolerance)
{
    e.mesh = mesh;
    e.mesh->places.clear();
    const bool isKnown = limit < levelSet.halfWidth() * levelSet.voxelSize(); // that far
    const Counts counts = countPlaces(levelSet, mesh.places, limit);
    const double each = 1 / double(mesh.places.size());
    e.meshWithin = isKnown ? double(counts.within) * each : 1;
    // Between two surfaces is at most their distance times the area, of which noise is on both
    // sides.
    const double apart =
        kMaxApart * std::min(counts.sum * each, tolerance) + kBetweenVoxels * levelSet.voxelSize();
    const bool volumeDiffers =
        mesh.isClosed && std::abs(e.volume - mesh.volume) > apart * std::max(mesh.area, e.area);
    if (1 - e.meshWithin <= kMaxUnexplained && !volumeDiffers) return;
    e.findings.push_back(fmt::format(
        "the surface through the mesh's vertices is not the mesh: {:.1f} % of its area is farther "
        "than {:.3g} from it, and its volume{} of {:.6g} became {:.6g}. Make a level set of its "
        "triangles with mpuvdb voxelize (Python: mpuvdb.mesh), or divide them",
        100 * (1 - e.meshWithin), limit, mesh.isClosed ? "" : " (open)", mesh.volume, e.volume));
}

/// Add findings to @a e.
void addFindings(PointsExplained& e, double voxelSize, const PointStatistics& points)
{
    if (points.fillSolid) { // which no normals fit either
        e.findings.push_back(
            "the points fill a solid: there is no surface that they lie about, at any scale, and "
            "the one that was made runs through their midst. Make a level set of the solid that "
            "they fill with mpuvdb particles (Python: mpuvdb.particles), or give points on its "
            "surface");
        return;
    }
    if (1 - e.within > kMaxUnexplained)
        e.findings.push_back(fmt::format(
            "{:.1f} % of the points are farther than {:.3g} from the surface (half a voxel, the "
            "tolerance, and three times the noise of {:.2g}): it does not show what they do. Look "
            "at their normals and noise; smaller voxels than {:.4g} show thinner parts",
            100 * (1 - e.within), e.limit, points.noise, voxelSize));
    else if (e.largest > e.limit && double(e.beyondBand) > kMaxLost * double(e.points))
        e.findings.push_back(fmt::format(
            "{:.1f} % of the points are farther than {:.3g} from the surface, beyond its band: "
            "what they show is not there. Smaller voxels than {:.4g} show smaller parts; points "
            "of none are outliers",
            100 * double(e.beyondBand) / double(e.points), e.largest, voxelSize));
    if (e.against > kMaxOff)
        e.findings.push_back(fmt::format(
            "the normals of {:.0f} % of the points are more than 60 degrees off the surface "
            "through "
            "them: they are none of its points (placeholders, directions of view, components "
            "without signs?). Estimate them with --normals estimate (Python: orient='estimate')",
            100 * e.against));
}

/// Tell of a surface that leaves the points: they are too few for one, or look into the void.
void compareExtent(PointsExplained& e, const LevelSet& levelSet, const Counts& counts,
                   const Vec3d& frame)
{
    /// Distance from the box of the points, in its diagonals. [derived: a cap of a ball that is
    /// seen from 30 degrees about its middle is completed that far]
    constexpr double kMaxBeyond = 1;
    openvdb::CoordBBox voxels; // of leaves first, which takes no look at voxels
    if (counts.points == 0 || !levelSet.grid().tree().evalLeafBoundingBox(voxels)) return;
    const Lattice lattice = levelSet.lattice();
    const auto corner = [&](const openvdb::Coord& c, double inward) {
        return Vec3d(lattice.origin +
                     lattice.voxelSize * (Vec3d(c.x(), c.y(), c.z()).array() + inward).matrix() -
                     frame);
    };
    const auto beyondPoints = [&](const openvdb::CoordBBox& voxels) {
        const Vec3d low = counts.box.min() - corner(voxels.min(), levelSet.halfWidth()),
                    high = corner(voxels.max(), -levelSet.halfWidth()) - counts.box.max();
        return std::max(low.maxCoeff(), high.maxCoeff());
    };
    const double diagonal = counts.box.diagonal().norm(),
                 limit = kMaxBeyond * diagonal + levelSet.voxelSize();
    if (!(beyondPoints(voxels) > limit)) return;
    levelSet.grid().tree().evalActiveVoxelBoundingBox(voxels);
    const double beyond = beyondPoints(voxels);
    if (!(beyond > limit)) return;
    e.findings.push_back(fmt::format(
        "the surface reaches {:.3g} beyond the points, farther than all of them reach ({:.3g}): "
        "{} points do not enclose anything, or their normals look into the void. Give more points, "
        "or estimate their normals (--normals estimate)",
        beyond, diagonal, counts.points));
}

} // namespace

PointsExplained explain(const LevelSet& levelSet, const MpuField& field,
                        const std::optional<Box3d>& region, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    const MpuSettings& fit = field.settings();
    const FieldPoints points = field.points();
    PointsExplained e;
    e.limit =
        kMaxVoxelError * levelSet.voxelSize() + fit.tolerance + kMaxDeviations * fit.points.noise;
    const Counts counts = countPoints(levelSet, field, e.limit, region, progress);
    e.points = counts.points;
    const double each = 1 / double(std::max<std::uint64_t>(counts.points, 1));
    e.within = counts.points ? double(counts.within) * each : 1;
    e.against = double(counts.off) * each;
    e.largest = counts.largest;
    e.beyondBand = counts.beyondBand;
    e.unsupported = unsupportedShare(levelSet, field, progress);
    addFindings(e, levelSet.voxelSize(), fit.points);
    if (region) return e; // the rest applies to the whole
    const SolidBlocks blocks(levelSet, progress);
    const PartCounts parts = countParts(levelSet, blocks, progress);
    e.volume = blocks.sums().volume;
    e.area = blocks.sums().area;
    e.parts = parts.parts;
    e.cavities = parts.cavities;
    compareExtent(e, levelSet, counts, points.frame);
    if (points.mesh)
        compareWithMesh(e, levelSet, *points.mesh, e.limit + fit.points.spacing / 2, fit.tolerance);
    return e;
}

PointsExplained joinExplained(const std::vector<std::pair<PointsExplained, std::uint64_t>>& parts,
                              const PointStatistics& points, double voxelSize)
{
    PointsExplained whole;
    double within = 0, off = 0, unsupported = 0, voxels = 0;
    for (const auto& [part, active] : parts) {
        const auto count = double(part.points);
        whole.points += part.points;
        whole.limit = std::max(whole.limit, part.limit);
        whole.largest = std::max(whole.largest, part.largest);
        whole.beyondBand += part.beyondBand;
        within += part.within * count;
        off += part.against * count;
        unsupported += part.unsupported * double(active);
        voxels += double(active);
    }
    const double each = 1 / double(std::max<std::uint64_t>(whole.points, 1));
    whole.within = whole.points ? within * each : 1;
    whole.against = off * each;
    whole.unsupported = voxels > 0 ? unsupported / voxels : 0;
    addFindings(whole, voxelSize, points);
    return whole;
}

} // namespace mpuvdb
