#include "thickness.h"

#include "surface/place_tree.h"
#include "surface/surface_cells.h"

#include <mpuvdb/interrupter.h>

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using Leaf = LeafWindow::Leaf;

/// The most places where thickness is measured. [tuned: solid_measures_test; bounds the time]
constexpr std::uint64_t kMaxPlaces = 1 << 18;
/// The edge of a leaf, voxels. [derived: OpenVDB's leaves]
constexpr int kLeaf = int(Leaf::DIM);
/// The least gradient of places that are measured: across creases, or in the middle of walls of a
/// voxel or two, it is shorter. [tuned: solid_measures_test]
constexpr double kMinGradient = 0.85;
/// The largest cosine between normals that face each other, and the least one between those of
/// neighbors on a ball, whose noise hides its radius. [tuned: solid_measures_test]
constexpr float kFacing = -0.5f, kNeighbors = 0.7f;
/// The depth, in radii, to which places may reach into a ball that counts as empty. Where all of a
/// surface is about as far from the center, nodes flat to this depth, sqrt(4 kTolerance) radii
/// wide, are skipped, so that a ball meets some pi / kTolerance of them. [derived: half of two
/// percent, the least that measure() promises]
constexpr float kTolerance = 1e-2f;
/// The places in a run, each of which begins with the contact of the one before; independent of the
/// threads. [derived: long beside the one place that begins without]
constexpr std::size_t kRun = 256;

/// Whether the crossing of a voxel's edge along an axis is the one chosen of about @a stride.
bool isChosen(const Coord& at, int axis, std::uint64_t stride)
{
    const auto mixed = (std::uint32_t(at[0]) * 73856093u) ^ (std::uint32_t(at[1]) * 19349663u) ^
                       (std::uint32_t(at[2]) * 83492791u) ^ (std::uint32_t(axis) * 2654435761u);
    return (mixed >> 3) % stride == 0;
}

/// The crossings of the edges that start in a leaf, each moved onto the curved surface.
void addPlaces(const LeafWindow& window, const Coord& origin, const Coord& home,
               std::uint64_t stride, Places& places)
{
    const Coord o = origin - home;
    const Vec3d offset(o[0], o[1], o[2]);
    for (int n = 0; n < kBlockVoxels; ++n) {
        const Vec3i base(n / (kLeaf * kLeaf), n / kLeaf % kLeaf, n % kLeaf);
        const double v = double(window(base));
        for (int axis = 0; axis < 3; ++axis) {
            const double u = double(window(base + Vec3i::Unit(axis)));
            if ((u < 0) == (v < 0)) continue;
            if (!isChosen(origin.offsetBy(base[0], base[1], base[2]), axis, stride)) continue;
            Vec3d p = base.cast<double>() + v / (v - u) * Vec3d::Unit(axis);
            const CellQuadric quadric(window, base);
            const Vec3d gradient = quadric.smooth ? quadric.gradientAt(p) : quadric.gradient;
            const double slope = gradient.norm();
            if (slope < kMinGradient) continue;
            if (quadric.smooth) p -= quadric.valueAt(p) / (slope * slope) * gradient;
            places.positions.emplace_back((offset + p).cast<float>());
            places.normals.emplace_back((gradient / slope).cast<float>());
        }
    }
}

Places findPlaces(const LevelSet& levelSet, std::uint64_t stride, Interrupter& progress)
{
    std::vector<const Leaf*> leaves;
    levelSet.grid().tree().getNodes(leaves);
    std::vector<Places> found(leaves.size());
    tbb::parallel_for(
        tbb::blocked_range<std::size_t>(0, leaves.size(), 16),
        [&](const tbb::blocked_range<std::size_t>& range) {
            LeafWindow window(levelSet.grid().tree(), levelSet.voxelSize(), levelSet.halfWidth());
            for (std::size_t n = range.begin(); n < range.end(); ++n) {
                progress.check();
                window.load(*leaves[n]);
                addPlaces(window, leaves[n]->origin(), leaves[0]->origin(), stride, found[n]);
            }
        });
    Places all;
    for (const Places& some : found) {
        all.positions.insert(all.positions.end(), some.positions.begin(), some.positions.end());
        all.normals.insert(all.normals.end(), some.normals.begin(), some.normals.end());
    }
    return all;
}

/// The largest ball inside that touches a place.
struct Ball {
    float radius = 0;
    bool isBetweenWalls = false; ///< that face each other
};

/// Shrinks balls until none of the places is inside.
class BallFinder
{
public:
    /// @param spacing  of the places, voxels.
    BallFinder(const Places& places, const PlaceTree& tree, float largest, float spacing)
        : mPlaces(places), mTree(tree), mLargest(largest), mSpacing(spacing)
    {
    }

    /// The ball at a place; fastest after a nearby one.
    Ball find(std::uint32_t place)
    {
        const Vec3f &p = mPlaces.positions[place], &n = mPlaces.normals[place];
        const std::uint32_t before = mContact;
        mContact = kNone;
        setRadius(mLargest, p, n);
        if (before != kNone) touch(p, n, before);
        mTree.search([&](const PlaceTree::Node& node) { return orderOf(node, p, n); },
                     [&](std::uint32_t other) { touch(p, n, other); });
        if (mContact == kNone) return {mRadius, isFacing(place, mRadius)};
        const Vec3f& facing = mPlaces.normals[mContact];
        const float radius = touchingPlane(p, n, mPlaces.positions[mContact], facing);
        return {radius, n.dot(facing) <= kFacing || isFacing(place, radius)};
    }

private:
    static constexpr std::uint32_t kNone = 0xffffffff; ///< no index [derived: the largest]
    /// The distances, in radii, beside and beyond a ball's far end, within which the surface there
    /// touches it. [tuned: solid_measures_test]
    static constexpr float kNearby = 0.1f, kLevel = 0.02f;

    /// The squared distance of @a node to the center of the ball at @a p; kNever where it cannot
    /// touch.
    float orderOf(const PlaceTree::Node& node, const Vec3f& p, const Vec3f& n) const
    {
        const float order = node.squaredDistance(mCenter, mReach);
        if (order == PlaceTree::kNever) return order;
        const float height = n.dot(p) + node.farthest(-n);
        return isBelow(height, node.squaredBoxDistance(p)) ? order : PlaceTree::kNever;
    }

    /// Whether a place @a height below a tangent plane, at a distance from where that touches, is
    /// none of the neighbors there.
    static bool isBelow(float height, float squaredDistance)
    {
        // [derived: the squared sine of half the angle of kNeighbors]
        constexpr float kSquaredSine = (1 - kNeighbors) / 2;
        // The least height, voxels, of another wall: edges that meet in a voxel on the surface
        // cross it in one place, to rounding. [derived: a tenth of the thinnest wall of a level
        // set]
        constexpr float kLeastHeight = 0.1f;
        return height > kLeastHeight && height * height > kSquaredSine * squaredDistance;
    }

    void setRadius(float radius, const Vec3f& p, const Vec3f& n)
    {
        mRadius = radius;
        mReach = radius * (1 - kTolerance);
        mCenter = p - radius * n;
    }

    /// Shrink the ball at @a p until it has @a other on its surface.
    void touch(const Vec3f& p, const Vec3f& n, std::uint32_t other)
    {
        const Vec3f back = p - mPlaces.positions[other];
        const float height = n.dot(back), squared = back.squaredNorm();
        if (!isBelow(height, squared) || !(squared < 2 * height * mRadius)) return;
        setRadius(squared / (2 * height), p, n);
        mContact = other;
    }

    /// The radius of the ball that touches the tangent plane of the contact: the surface touches
    /// the ball between places. It may differ by no more than the spacing explains.
    float touchingPlane(const Vec3f& p, const Vec3f& n, const Vec3f& contact,
                        const Vec3f& facing) const
    {
        const float opening = 1 - facing.dot(n);
        if (opening < 1 - kNeighbors) return mRadius;
        const float touching = facing.dot(contact - p) / opening;
        const float most = std::max(0.1f * mRadius, mSpacing * mSpacing / mRadius);
        return touching > 0 && std::abs(touching - mRadius) <= most ? touching : mRadius;
    }

    /// Whether the ball touches the surface also where it is farthest from the place.
    bool isFacing(std::uint32_t place, float radius) const
    {
        const Vec3f& n = mPlaces.normals[place];
        const Vec3f opposite = mPlaces.positions[place] - 2 * radius * n;
        float distance = kNearby * radius + mSpacing;
        std::uint32_t nearest = kNone;
        mTree.search(
            [&](const PlaceTree::Node& node) { return node.squaredDistance(opposite, distance); },
            [&](std::uint32_t other) {
                const float d = (mPlaces.positions[other] - opposite).norm();
                if (!(d < distance)) return;
                distance = d;
                nearest = other;
            });
        if (nearest == kNone) return false;
        const Vec3f& facing = mPlaces.normals[nearest];
        return n.dot(facing) <= kFacing &&
               std::abs((mPlaces.positions[nearest] - opposite).dot(facing)) <= kLevel * radius;
    }

    const Places& mPlaces;
    const PlaceTree& mTree;
    float mLargest, mSpacing;
    float mRadius = 0; ///< of the ball that is being found
    float mReach = 0;  ///< within which places are inside the ball
    Vec3f mCenter = Vec3f::Zero();
    std::uint32_t mContact = kNone;
};

/// The balls at places on a surface.
struct Balls {
    openvdb::Coord home; ///< the voxel that places are relative to
    Places places;       ///< in the tree's order
    std::optional<PlaceTree> tree;
    std::vector<Ball> balls; ///< of the places, voxels

    Balls(const LevelSet& levelSet, std::uint64_t crossings, Interrupter& progress)
    {
        const std::uint64_t stride = crossings / kMaxPlaces + 1;
        places = findPlaces(levelSet, stride, progress);
        if (places.size() == 0) return;
        home = levelSet.grid().tree().cbeginLeaf()->origin();
        Eigen::AlignedBox3f bounds;
        for (const Vec3f& p : places.positions) bounds.extend(p);
        tree.emplace(places, progress);
        balls.resize(places.size());
        tbb::parallel_for(std::size_t(0), (balls.size() + kRun - 1) / kRun, [&](std::size_t run) {
            progress.check();
            BallFinder finder(places, *tree, bounds.diagonal().norm(), std::sqrt(float(stride)));
            const std::size_t end = std::min((run + 1) * kRun, balls.size());
            for (std::size_t n = run * kRun; n < end; ++n) balls[n] = finder.find(std::uint32_t(n));
        });
    }

    /// The place nearest to @a p, voxels from home. @param first  where to look first.
    std::uint32_t nearest(const Vec3f& p, std::uint32_t first) const
    {
        float distance = (places.positions[first] - p).norm();
        const std::uint32_t found = tree->nearest(places, p, distance);
        return found == PlaceTree::kNone ? first : found;
    }
};

} // namespace

std::vector<float> thicknessAt(const LevelSet& levelSet, std::uint64_t crossings,
                               const std::vector<Vec3d>& feet, Interrupter& progress)
{
    std::vector<float> diameters(feet.size());
    const Balls found(levelSet, crossings, progress);
    if (found.balls.empty()) return diameters;
    const Lattice lattice = levelSet.lattice();
    const Vec3d home(found.home[0], found.home[1], found.home[2]);
    tbb::parallel_for(std::size_t(0), (feet.size() + kRun - 1) / kRun, [&](std::size_t run) {
        progress.check();
        std::uint32_t place = 0;
        for (std::size_t n = run * kRun; n < std::min((run + 1) * kRun, feet.size()); ++n) {
            const Vec3d at = (feet[n] - lattice.origin) / lattice.voxelSize - home;
            place = found.nearest(at.cast<float>(), place);
            diameters[n] = 2 * found.balls[place].radius * float(lattice.voxelSize);
        }
    });
    return diameters;
}

Thickness measureThickness(const LevelSet& levelSet, std::uint64_t crossings, Interrupter& progress)
{
    const Balls found(levelSet, crossings, progress);
    const Places& places = found.places;
    const std::vector<Ball>& balls = found.balls;
    if (balls.empty()) return {};
    const bool anyBetweenWalls =
        std::any_of(balls.begin(), balls.end(), [](const Ball& b) { return b.isBetweenWalls; });
    double sum = 0, weights = 0;
    float least = std::numeric_limits<float>::max();
    for (std::size_t n = 0; n < balls.size(); ++n) {
        // A surface is crossed by axes in proportion to its normal's 1-norm.
        const double weight = 1 / double(places.normals[n].lpNorm<1>());
        sum += weight * 2 * double(balls[n].radius);
        weights += weight;
        if (balls[n].isBetweenWalls || !anyBetweenWalls)
            least = std::min(least, 2 * balls[n].radius);
    }
    const double h = levelSet.voxelSize();
    return {double(least) * h, sum / weights * h};
}

} // namespace mpuvdb
