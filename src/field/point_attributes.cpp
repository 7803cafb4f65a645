#include "point_attributes.h"

#include "lattice_window.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace mpuvdb
{
namespace
{

using Box = Eigen::AlignedBox3f;

/// Nodes of a window, unless it is of one place: what fits into a cache; changes times alone.
constexpr std::size_t kMostNodes = 1 << 17;
/// What points of opposite normals weigh at level 0, and more where steps are longer: as points in
/// full from four times the step on.
constexpr float kAgainst = 1.0f / 16;
constexpr int kFineFrom = 2; ///< level from which on nodes are closer, so that no cell shows
/// Shares of the points of a whole surface about a place that are too few, and enough, of a level
/// [tuned: half of them are there at a rim; 0.05 and 0.4 leave 2 % more noise, lattices show far
/// from points].
constexpr float kFew = 0.1f, kEnough = 0.5f;

/// How much of a place's value a level gives that has such a share of @a points about it.
float shareOf(float points)
{
    if (points >= kEnough) return 1;
    if (!(points > kFew)) return 0;
    const float t = (points - kFew) / (kEnough - kFew);
    return t * t * (3 - 2 * t);
}

} // namespace

/// Blends at some places; scratch memory of one thread.
class PointAttributes::Blender
{
public:
    explicit Blender(const PointAttributes& of) : mOf(of) {}

    void blend(const std::vector<SurfacePlace>& places, std::vector<float>& values)
    {
        const std::size_t channels = mOf.channels();
        values.resize(places.size() * channels);
        for (std::size_t n = 0; n < values.size(); n += channels)
            for (std::size_t c = 0; c < channels; ++c) values[n + c] = mOf.mPoints.reference(c);
        mPositions.reserve(places.size());
        for (const SurfacePlace& place : places)
            mPositions.push_back((place.position - mOf.mFrame).cast<float>());
        mPlaces = places.data();
        mValues = values.data();
        blendThose(0, places.size());
    }

private:
    /// Blend at the places from @a begin on, all at once if their window is small enough.
    void blendThose(std::size_t begin, std::size_t end)
    {
        if (begin == end) return;
        Box box;
        for (std::size_t n = begin; n < end; ++n) box.extend(mPositions[n]);
        int level = mOf.mPoints.finestLevel(box);
        if (end - begin > 1 &&
            LatticeWindow::nodesOf(box, mOf.mPoints.step(level)) > double(kMostNodes)) {
            const std::size_t middle = begin + (end - begin) / 2;
            blendThose(begin, middle);
            blendThose(middle, end);
            return;
        }
        mOpen.resize(end - begin);
        mTilts.resize(end - begin);
        mShares.assign(end - begin, 1);
        for (std::size_t n = 0; n < mOpen.size(); ++n) {
            mOpen[n] = std::uint32_t(begin + n);
            const Vec3f normal = mPlaces[begin + n].normal.cast<float>();
            mTilts[n] = {1, normal[0], normal[1], normal[2]};
        }
        for (; !mOpen.empty(); ++level) blendAt(level);
    }

    /// Give the open places what is seen at a level, and keep those that are open still.
    void blendAt(int level)
    {
        const MomentTree& points = mOf.mPoints;
        const float step = points.step(level);
        Box box;
        for (const std::uint32_t place : mOpen) box.extend(mPositions[place]);
        mLatticeWindow.open(box, step, level < kFineFrom ? 1 : 2, points.length());
        mSpots.resize(mOpen.size());
        for (std::size_t n = 0; n < mOpen.size(); ++n)
            mSpots[n] = mLatticeWindow.want(mPositions[mOpen[n]]);
        mLatticeWindow.clear();
        points.forEach(mLatticeWindow.reach(), level,
                       [this](const Vec3f& p) { return mLatticeWindow.add(p); });
        mLatticeWindow.addingEnds();
        mLatticeWindow.read(mSpots, mTilts, std::min(std::ldexp(kAgainst, level), 1.0f), mSeen);
        const std::size_t channels = mOf.channels(), stride = points.length() / 4;
        const float perStep = std::ldexp(1.0f, -level); // the area of a step squared
        const bool mayBeLast = points.mayBeSeenWhole(step);
        std::size_t kept = 0;
        for (std::size_t n = 0; n < mOpen.size(); ++n) {
            const float* const seen = mSeen.data() + n * stride;
            const bool last = mayBeLast && points.isSeenWhole(mPositions[mOpen[n]], step);
            const float share = last ? mShares[n] : mShares[n] * shareOf(perStep * seen[0]);
            if (share > 0) {
                float* const values = mValues + mOpen[n] * channels;
                const float scale = share / seen[0];
                for (std::size_t c = 0; c < channels; ++c) values[c] += scale * seen[c + 1];
            }
            if (!(mShares[n] > share)) continue;
            mShares[kept] = mShares[n] - share;
            mTilts[kept] = mTilts[n];
            mOpen[kept++] = mOpen[n];
        }
        mOpen.resize(kept);
        mTilts.resize(kept);
    }

    const PointAttributes& mOf;
    const SurfacePlace* mPlaces = nullptr;
    float* mValues = nullptr;
    std::vector<Vec3f> mPositions;
    LatticeWindow mLatticeWindow;
    std::vector<std::uint32_t> mOpen;        ///< places whose values are not yet whole
    std::vector<LatticeWindow::Tilt> mTilts; ///< theirs
    std::vector<float> mShares;              ///< of their values, that levels to come give
    std::vector<LatticeWindow::Spot> mSpots;
    std::vector<float> mSeen;
};

PointAttributes::Named PointAttributes::find(const SortedPoints& points,
                                             const std::vector<std::string>& names)
{
    Named result;
    const auto& scalars = points.scalarNames();
    const std::size_t colors = points.hasColors() ? 3 : 0;
    for (const std::string& name : names) {
        const auto found = std::find(scalars.begin(), scalars.end(), name);
        const auto place = std::size_t(found - scalars.begin());
        if (name == kColorName && colors > 0) {
            result.hasColors = true;
            for (std::size_t c = 0; c < colors; ++c)
                result.channels.insert(result.channels.begin() + std::ptrdiff_t(c),
                                       points.channels()[c].data());
        } else if (name == "confidence" || found != scalars.end()) {
            result.scalarNames.push_back(name);
            result.channels.push_back(found != scalars.end()
                                          ? points.channels()[colors + place].data()
                                          : points.points().confidence.data());
        } else {
            throw UsageError(fmt::format("the points have no '{}': name {}confidence{}{}", name,
                                         colors > 0 ? "Cd, " : "", scalars.empty() ? "" : ", ",
                                         fmt::join(scalars, ", ")));
        }
    }
    return result;
}

PointAttributes::PointAttributes(const SortedPoints& points, const Vec3d& frame,
                                 const std::vector<std::string>& names)
    : mFrame(frame), mNamed(find(points, names)), mPoints(points, mNamed.channels)
{
}

void PointAttributes::evaluate(const std::vector<SurfacePlace>& places,
                               std::vector<float>& values) const
{
    Blender(*this).blend(places, values);
}

} // namespace mpuvdb
