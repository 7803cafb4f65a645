#include "ball_path.h"

#include "core/parallel_each.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;

/// The distance from one place of the path to the next, voxels. [tuned: shape_test; twice as far,
/// fillets that end on edges err by up to twice as much]
constexpr float kStep = 0.5f;
/// The least distance between two places, in steps. [derived: above half, so that no step of the
/// path has more than two; below 1, so that a step always finds room]
constexpr float kApart = 0.75f;
/// Steps of Newton's method, and the distance to both solids less the radius, voxels, before the
/// last one. [derived: few, or none converge; that step's error is the square over the radius]
constexpr int kNewtonSteps = 8;
constexpr float kConverged = 1e-3f;
/// The least squared sine of the angle between the solids. [derived: at two degrees a fillet is as
/// deep as 1.5e-4 of its radius]
constexpr float kLeastSine2 = 1e-3f;

/// The least turn of the direction to a solid, radians, from half a step to the next that makes a
/// corner of the path. [derived: less misplaces the fillet's rim by as much, which changes
/// distances by half its square]
constexpr float kCornerTurn = 0.1f;
/// The least turn of the path itself. [derived: that of a circle with a radius of a voxel]
constexpr float kCornerBend = 0.5f;

bool before(const Vec3f& a, const Vec3f& b)
{
    return std::lexicographical_compare(a.data(), a.data() + 3, b.data(), b.data() + 3);
}

/// Places no two of which are near to each other.
class Spread
{
public:
    /// Add @a p unless one is near.
    bool add(const Vec3f& p)
    {
        const Coord home = cellOf(p);
        for (int n = 0; n < 27; ++n) {
            const auto cell = mCells.find(home.offsetBy(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1));
            if (cell == mCells.end()) continue;
            for (const Vec3f& other : cell->second)
                if ((other - p).squaredNorm() < kApart * kApart * kStep * kStep) return false;
        }
        mCells[home].push_back(p);
        return true;
    }

private:
    static Coord cellOf(const Vec3f& p)
    {
        return {int(std::floor(p[0] / kStep)), int(std::floor(p[1] / kStep)),
                int(std::floor(p[2] / kStep))};
    }

    std::unordered_map<Coord, std::vector<Vec3f>> mCells;
};

} // namespace

BallPath::BallPath(const RolledSurface& a, const RolledSurface& b, float radius,
                   std::vector<Vec3f> seeds, Interrupter& progress)
    : mA(a), mB(b), mRadius(radius)
{
    trace(std::move(seeds), progress);
    mPlaces.normals.resize(mPlaces.size());
    std::vector<Center> centers(mPlaces.size());
    forEachParallel(centers.size(), 16, progress, [&](std::size_t n) {
        centers[n] = centerAt(mPlaces.positions[n]);
        mPlaces.normals[n] = (centers[n].toA + centers[n].toB).normalized();
    });
    mTree = std::make_unique<PlaceTree>(mPlaces, progress);
    mCenters.reserve(centers.size());
    for (const std::uint32_t n : mTree->order()) mCenters.push_back(centers[n]);
}

/// The place of the path near @a center, by Newton's method.
BallPath::Contact BallPath::contactNear(Vec3f center) const
{
    Contact contact;
    const float most = 2 * mRadius + 2 * kStep;
    for (int step = 0; step < kNewtonSteps; ++step) {
        const PatchTree::Near a = mA.tree().nearest(center, most),
                              b = mB.tree().nearest(center, most);
        if (!a.isFound() || !b.isFound() || !(a.distance > 0) || !(b.distance > 0)) return contact;
        contact.toA = (a.place - center) / a.distance;
        contact.toB = (b.place - center) / b.distance;
        const float offA = a.distance - mRadius, offB = b.distance - mRadius;
        const float cosine = contact.toA.dot(contact.toB), sine2 = 1 - cosine * cosine;
        if (!(sine2 > kLeastSine2)) return contact;
        const Vec3f move = (offA - cosine * offB) / sine2 * contact.toA +
                           (offB - cosine * offA) / sine2 * contact.toB;
        if (!(move.norm() < most)) return contact;
        center += move;
        if (std::max(std::abs(offA), std::abs(offB)) > kConverged) continue;
        contact.center = center;
        contact.isFound = !mA.holds(center) && !mB.holds(center);
        return contact;
    }
    return contact;
}

/// Find places all along the path, one each step.
void BallPath::trace(std::vector<Vec3f>&& seeds, Interrupter& progress)
{
    std::vector<Contact> found(seeds.size());
    forEachParallel(seeds.size(), 16, progress,
                    [&](std::size_t n) { found[n] = contactNear(seeds[n]); });
    std::sort(found.begin(), found.end(),
              [](const Contact& l, const Contact& r) { return before(l.center, r.center); });
    Spread spread;
    std::vector<Vec3f>& places = mPlaces.positions;
    const auto follow = [&](Contact from, float way) {
        for (Vec3f along = way * from.toA.cross(from.toB).normalized();;) {
            progress.check();
            const Contact next = contactNear(from.center + kStep * along);
            const Vec3f went = next.center - from.center;
            // A path that has ended leads to another part, or back.
            if (!next.isFound || went.norm() > 2 * kStep || !spread.add(next.center)) return;
            places.push_back(next.center);
            const Vec3f tangent = next.toA.cross(next.toB).normalized();
            along = std::copysign(1.0f, tangent.dot(went)) * tangent;
            from = next;
        }
    };
    for (const Contact& seed : found) {
        if (!seed.isFound || !spread.add(seed.center)) continue;
        places.push_back(seed.center);
        follow(seed, 1);
        follow(seed, -1);
    }
}

BallPath::Center BallPath::centerAt(const Vec3f& place) const
{
    const Contact here = contactNear(place);
    Center center;
    center.center = here.center;
    center.tangent = here.toA.cross(here.toB).normalized();
    center.toA = here.toA;
    center.toB = here.toB;
    const float half = kStep / 2;
    const Contact low = contactNear(here.center - half * center.tangent),
                  high = contactNear(here.center + half * center.tangent);
    const auto second = [](const Vec3f& a, const Vec3f& b, const Vec3f& c) {
        return Vec3f((c - b) - (b - a));
    };
    // Where a ball begins to turn about an edge, that begins at once.
    const float turn = kCornerTurn + half / mRadius;
    center.isSmooth = low.isFound && high.isFound &&
                      second(low.center, here.center, high.center).norm() < kCornerBend * half &&
                      second(low.toA, here.toA, high.toA).norm() < turn &&
                      second(low.toB, here.toB, high.toB).norm() < turn;
    if (!center.isSmooth) {
        for (const Contact* arm : {&low, &high})
            if (arm->isFound && (arm->center - here.center).norm() < kStep)
                center.arms[arm == &high] = (arm->center - here.center) / half;
        return center;
    }
    center.bend = second(low.center, here.center, high.center) / (half * half);
    center.turnA = (high.toA - low.toA) / (2 * half);
    center.turnB = (high.toB - low.toB) / (2 * half);
    return center;
}

BallPath::Near BallPath::nearest(const Vec3f& p, float most) const
{
    Near near{most};
    const std::uint32_t found = mTree->nearest(mPlaces, p, near.distance);
    if (found == PlaceTree::kNone) return near;
    near.isFound = true;
    const Center& c = mCenters[found];
    const Vec3f from = p - c.center;
    if (!c.isSmooth) {
        for (const Vec3f& arm : c.arms) {
            if (arm.isZero()) continue;
            const float along = std::clamp(from.dot(arm) / arm.squaredNorm(), 0.0f, kStep);
            near.distance = std::min(near.distance, (from - along * arm).norm());
        }
        return near;
    }
    const float wanted = from.dot(c.tangent) / std::max(1 - from.dot(c.bend), 0.5f);
    const float along = std::clamp(wanted, -kStep, kStep);
    near.isBeside = along == wanted;
    const Vec3f to = from - along * c.tangent - 0.5f * along * along * c.bend;
    near.distance = to.norm();
    const Vec3f a = (c.toA + along * c.turnA).normalized(),
                b = (c.toB + along * c.turnB).normalized();
    const float cosine = a.dot(b), onA = to.dot(a), onB = to.dot(b);
    near.isBetween = onA > cosine * onB && onB > cosine * onA;
    return near;
}

} // namespace mpuvdb
