#include "point_attributes.h"

#include "core/clones.h"
#include "core/lanes.h"
#include "lattice_window.h"
#include <mpuvdb/error.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <numeric>

namespace mpuvdb
{
namespace
{

using Box = Eigen::AlignedBox3f;

/// Most nodes of a window of more than one place. [free: a cache's size]
constexpr std::size_t kMaxWindowNodes = 1 << 17;
/// Weight of points of opposite normals at level 0; it grows with the square of the step, to 1 from
/// four times the step on. [tuned: attributes_test]
constexpr float kOpposedWeight = 1.0f / 16;
/// Shares of the points of a whole surface about a place between which a level's weight rises from
/// 0 to 1. [tuned: attributes_bench and ColorsOfCasesReachTheBackOfASheet; 0.1 and 0.5 leave 4 %
/// less noise, and colors behind an open sheet are 1.8 times as far from those of the nearest
/// points; 0.03 and 0.2 bring them 9 % nearer]
constexpr float kMinShare = 0.05f, kFullShare = 0.25f;

/// Weight of a level with the share @a points of a whole surface's points about a place.
float shareOf(float points)
{
    const float t = std::min(std::max((points - kMinShare) / (kFullShare - kMinShare), 0.0f), 1.0f);
    return t * t * (3 - 2 * t);
}

/// Split places into positions from @a frame, and 1 and their normals.
MPUVDB_CLONES
void split(const std::vector<SurfacePlace>& places, const Vec3d& frame, Quad* positions,
           Quad* tilts)
{
    using Four = double __attribute__((vector_size(32)));
    const Four origin{frame[0], frame[1], frame[2], 0};
    for (const SurfacePlace& place : places) {
        const double* const numbers = place.position.data(); // and after it the normal
        positions->lanes = __builtin_convertvector(lanesAt<Four>(numbers) - origin, Quad::Lanes);
        (positions++)->lanes[3] = 0;
        tilts->lanes = __builtin_convertvector(lanesAt<Four>(numbers + 2), Quad::Lanes);
        (tilts++)->lanes[0] = 1;
    }
}

} // namespace

/// Blends at places, with the scratch memory of one thread.
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
        mPositions.resize(places.size());
        mTilts.resize(places.size());
        split(places, mOf.mFrame, mPositions.data(), mTilts.data());
        mValues = values.data();
        blendRange(0, places.size());
    }

private:
    /// Blend at the places from @a begin on, all at once if their window is small enough.
    void blendRange(std::size_t begin, std::size_t end)
    {
        if (begin == end) return;
        mBox = boxOf(end - begin, [&](std::size_t n) { return begin + n; });
        int level = mOf.mPoints.finestLevel(mBox);
        if (end - begin > 1 &&
            LatticeWindow::nodesOf(mBox, mOf.mPoints.step(level)) > double(kMaxWindowNodes)) {
            const std::size_t middle = begin + (end - begin) / 2;
            blendRange(begin, middle);
            blendRange(middle, end);
            return;
        }
        mOpen.resize(end - begin);
        std::iota(mOpen.begin(), mOpen.end(), std::uint32_t(begin));
        mShares.assign(mOpen.size(), 1);
        for (; !mOpen.empty(); ++level) blendAt(level);
    }
    template <typename F>
    Box boxOf(std::size_t count, F placeAt) const
    {
        Quad low = mPositions[placeAt(0)], high = low;
        for (std::size_t n = 1; n < count; ++n) {
            const Quad::Lanes& p = mPositions[placeAt(n)].lanes;
            low.lanes = p < low.lanes ? p : low.lanes;
            high.lanes = p > high.lanes ? p : high.lanes;
        }
        return {low.head(), high.head()};
    }
    /// Blend a level into the open places, and keep those that are still open.
    void blendAt(int level)
    {
        const MomentTree& points = mOf.mPoints;
        const float step = points.step(level);
        mLatticeWindow.open(mBox, step, MomentTree::nodesPerStep(level), points.length());
        mLatticeWindow.request(mPositions, mOpen, mSpots);
        points.forEach(mLatticeWindow.reach(), level,
                       [this](const Vec3f& p) { return mLatticeWindow.add(p); });
        mLatticeWindow.flush();
        mLatticeWindow.read(mSpots, mTilts, mOpen,
                            std::min(std::ldexp(kOpposedWeight, 2 * level), 1.0f), mMeans);
        applyMeans(level);
    }

    /// Add a level's means to the open places by their weights, and keep those still open.
    void applyMeans(int level)
    {
        const MomentTree& points = mOf.mPoints;
        const std::size_t channels = mOf.channels(), stride = points.length() / 4;
        const float step = points.step(level);
        const float perStep = std::ldexp(1.0f, -2 * level); // the area of a step squared
        const bool mayBeLast = points.mayCoverAll(step);
        std::size_t kept = 0;
        for (std::size_t n = 0; n < mOpen.size();
             ++n) { // without branches: none could be predicted
            const float* const means = mMeans.data() + n * stride;
            const bool last = mayBeLast && points.coversAll(mPositions[mOpen[n]].head(), step);
            const float share = mShares[n] * (last ? 1 : shareOf(perStep * means[0]));
            float* const values = mValues + mOpen[n] * channels;
            const float scale = share / std::max(means[0], std::numeric_limits<float>::min());
            for (std::size_t c = 0; c < channels; ++c) values[c] += scale * means[c + 1];
            const bool open = mShares[n] > share;
            mShares[kept] = mShares[n] - share;
            mOpen[kept] = mOpen[n];
            kept += std::size_t(open);
        }
        mOpen.resize(kept);
        mShares.resize(kept);
        mBox = kept > 0 ? boxOf(kept, [this](std::size_t n) { return mOpen[n]; }) : Box();
    }

    const PointAttributes& mOf;
    float* mValues = nullptr;
    std::vector<Quad> mPositions, mTilts; ///< of the places
    LatticeWindow mLatticeWindow;
    std::vector<std::uint32_t> mOpen; ///< places whose weights do not add up to 1 yet
    Box mBox;                         ///< around their positions
    std::vector<float> mShares;       ///< the weights left to coarser levels
    std::vector<LatticeWindow::Spot> mSpots;
    std::vector<float> mMeans;
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
                                          : points.points().confidence);
        } else {
            throw UsageError(fmt::format("the points have no '{}': name {}confidence{}{}", name,
                                         colors > 0 ? "Cd, " : "", scalars.empty() ? "" : ", ",
                                         fmt::join(scalars, ", ")));
        }
    }
    return result;
}

PointAttributes::PointAttributes(const SortedPoints& points, const Vec3d& frame,
                                 const std::vector<std::string>& names, Interrupter& progress)
    : mFrame(frame), mNamed(find(points, names)), mPoints(points, mNamed.channels, progress)
{
}

void PointAttributes::evaluate(const std::vector<SurfacePlace>& places,
                               std::vector<float>& values) const
{
    std::unique_ptr<Blender>& blender = mBlenders.local();
    if (!blender) blender = std::make_unique<Blender>(*this);
    blender->blend(places, values);
}

PointAttributes::~PointAttributes() = default;

} // namespace mpuvdb
