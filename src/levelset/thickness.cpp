#include "thickness.h"

#include "surface_cells.h"

#include <mpuvdb/kd_tree.h>
#include <mpuvdb/progress.h>

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using Leaf = LeafWindow::Leaf;

constexpr std::uint64_t kMostPlaces = 1 << 18;
constexpr int kLeaf = int(Leaf::DIM);
/// Across a crease, or through the middle of a wall of a voxel or two, gradients are shorter.
constexpr double kLeastGradient = 0.85;
/// Cosines: of normals that face each other; of places on a ball that are neighbours, which tell
/// of its radius no more than their noise.
constexpr float kFacing = -0.5f, kNeighbours = 0.7f;
constexpr float kTouching = 1e-3f; ///< of the radius

/// Places on a surface, voxels.
struct Places {
    std::vector<Vec3f> positions, normals;
};

/// The one of every @a stride crossings that belongs to a voxel and an axis.
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
            if (slope < kLeastGradient) continue;
            if (quadric.smooth) p -= quadric.valueAt(p) / (slope * slope) * gradient;
            places.positions.emplace_back((offset + p).cast<float>());
            places.normals.emplace_back((gradient / slope).cast<float>());
        }
    }
}

Places findPlaces(const LevelSet& levelSet, std::uint64_t stride, Progress& progress)
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
    bool held = false; ///< between walls that face each other
};

/// Shrinks balls until none of the places is inside.
class BallFinder
{
public:
    /// @param spacing  of the places, voxels.
    BallFinder(const Places& places, const KdTree& tree, float largest, float spacing)
        : mPlaces(places), mTree(tree), mLargest(largest), mSpacing(spacing)
    {
    }

    Ball find(std::size_t place)
    {
        const Vec3f &p = mPlaces.positions[place], &n = mPlaces.normals[place];
        float radius = mLargest;
        std::size_t contact = place;
        for (int step = 0; step < kSteps; ++step) {
            const Vec3f centre = p - radius * n;
            if (isKnownEmpty(centre, radius * (1 - kTouching))) break;
            const std::size_t nearest = nearestTo(centre);
            const Vec3f toPlace = mPlaces.positions[nearest] - centre;
            const float distance = toPlace.norm();
            if (nearest == place || distance >= radius * (1 - kTouching)) {
                mEmptyCentre = centre;
                mEmptyRadius = distance;
                break;
            }
            const Vec3f back = p - mPlaces.positions[nearest];
            const float height = n.dot(back);
            if (!(height > 0)) break;
            const float next = back.squaredNorm() / (2 * height);
            const Vec3f there = (mPlaces.positions[nearest] - (p - next * n)) / next;
            if (n.dot(there) > kNeighbours || !(next < radius)) break;
            radius = next;
            contact = nearest;
        }
        if (contact == place) return {radius, isFacing(place, radius)};
        const Vec3f& facing = mPlaces.normals[contact];
        radius = touchingPlane(p, n, mPlaces.positions[contact], facing, radius);
        return {radius, n.dot(facing) <= kFacing || isFacing(place, radius)};
    }

private:
    static constexpr int kSteps = 40;
    /// Of the radius: how far beside a ball's end, and beyond it, the surface there may lie.
    static constexpr float kNearby = 0.1f, kLevel = 0.02f;

    /// Whether the last ball that was found empty says so. Where many places share one ball, all of
    /// them are about as near to its centre, and a search there would visit each.
    bool isKnownEmpty(const Vec3f& centre, float radius) const
    {
        constexpr float kRounding = 1e-5f;
        return (centre - mEmptyCentre).norm() + radius <= mEmptyRadius * (1 - kRounding);
    }

    std::size_t nearestTo(const Vec3f& p)
    {
        mIndex.resize(1);
        mSquared.resize(1);
        mTree.nearest(p, mIndex, mSquared);
        return mIndex[0];
    }

    /// The radius of the ball that touches the plane of the contact: the surface touches the ball
    /// between places. It may differ by what lies between places.
    float touchingPlane(const Vec3f& p, const Vec3f& n, const Vec3f& contact, const Vec3f& facing,
                        float radius) const
    {
        const float opening = 1 - facing.dot(n);
        if (opening < 1 - kNeighbours) return radius;
        const float touching = facing.dot(contact - p) / opening;
        const float most = std::max(0.1f * radius, mSpacing * mSpacing / radius);
        return touching > 0 && std::abs(touching - radius) <= most ? touching : radius;
    }

    /// Whether the ball touches the surface where it is farthest from the place, too.
    bool isFacing(std::size_t place, float radius)
    {
        const Vec3f& n = mPlaces.normals[place];
        const Vec3f opposite = mPlaces.positions[place] - 2 * radius * n;
        const std::size_t nearest = nearestTo(opposite);
        const Vec3f apart = mPlaces.positions[nearest] - opposite;
        const Vec3f& facing = mPlaces.normals[nearest];
        return n.dot(facing) <= kFacing && apart.norm() <= kNearby * radius + mSpacing &&
               std::abs(apart.dot(facing)) <= kLevel * radius;
    }

    const Places& mPlaces;
    const KdTree& mTree;
    float mLargest, mSpacing;
    Vec3f mEmptyCentre = Vec3f::Zero();
    float mEmptyRadius = 0; ///< no place is nearer to that centre
    std::vector<std::uint32_t> mIndex;
    std::vector<float> mSquared;
};

} // namespace

Thickness measureThickness(const LevelSet& levelSet, std::uint64_t crossings, Progress& progress)
{
    const std::uint64_t stride = crossings / kMostPlaces + 1;
    const Places places = findPlaces(levelSet, stride, progress);
    if (places.positions.empty()) return {};
    Eigen::AlignedBox3f bounds;
    for (const Vec3f& p : places.positions) bounds.extend(p);
    const KdTree tree(places.positions);
    progress.check();
    std::vector<Ball> balls(places.positions.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, balls.size(), 256),
                      [&](const tbb::blocked_range<std::size_t>& range) {
                          BallFinder finder(places, tree, bounds.diagonal().norm(),
                                            std::sqrt(float(stride)));
                          for (std::size_t n = range.begin(); n < range.end(); ++n) {
                              if (n % 32 == 0) progress.check();
                              balls[n] = finder.find(n);
                          }
                      });
    const bool anyHeld =
        std::any_of(balls.begin(), balls.end(), [](const Ball& b) { return b.held; });
    double sum = 0, weights = 0;
    float least = std::numeric_limits<float>::max();
    for (std::size_t n = 0; n < balls.size(); ++n) {
        // Axes meet a surface as often as its normal says.
        const double weight = 1 / double(places.normals[n].lpNorm<1>());
        sum += weight * 2 * double(balls[n].radius);
        weights += weight;
        if (balls[n].held || !anyHeld) least = std::min(least, 2 * balls[n].radius);
    }
    const double h = levelSet.voxelSize();
    return {double(least) * h, sum / weights * h};
}

} // namespace mpuvdb
