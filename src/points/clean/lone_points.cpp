// A count of those near a point settles nearly all; the few that have too few are compared with
// their neighbors, and with what lies about them at their own scale.
#include "lone_points.h"

#include "core/parallel_each.h"
#include "local_plane.h"
#include "spatial/point_cells.h"
#include "surroundings.h"

#include <algorithm>
#include <cmath>
#include <iterator>

namespace mpuvdb
{
namespace
{

/// The standard deviations by which noise moves a point at most. [derived: one point in two million
/// of a normal distribution is farther off]
constexpr double kNoises = 5;

/// Whether a point is off the plane of its neighbors, which themselves are on it.
class OffPlane
{
public:
    OffPlane(const std::vector<Vec3f>& positions, double noise)
        : mPositions(positions), mNoise(noise)
    {
    }

    bool isOff(std::uint32_t point, Surroundings& surroundings)
    {
        // Neighbors that are asked, and those of them that make the plane. [tuned:
        // clean_points_test]
        constexpr std::size_t kNeighbors = 12, kOnPlane = 9;
        constexpr double kOffSpacings = 2; // height over the plane; [tuned: clean_points_test]
        while (surroundings.count() < kNeighbors && surroundings.isWithinCells())
            surroundings.lookFarther();
        if (surroundings.count() < kNeighbors) return false;
        mMembers.clear();
        for (std::size_t k = 0; k < kNeighbors; ++k) mMembers.push_back(surroundings.near(k).point);
        // Some of them may be outliers too.
        const LocalPlane first = planeOf(mPositions, mMembers);
        std::sort(mMembers.begin(), mMembers.end(), [&](std::uint32_t a, std::uint32_t b) {
            return std::abs(first.height(mPositions[a])) < std::abs(first.height(mPositions[b]));
        });
        mMembers.resize(kOnPlane);
        const LocalPlane plane = planeOf(mPositions, mMembers);
        // A disc's variance along each axis is a quarter of its squared radius.
        const double squaredRadius = 2 * (plane.variances[1] + plane.variances[2]);
        const double spacing = std::sqrt(M_PI / double(kOnPlane) * squaredRadius);
        const double height = std::abs(plane.height(mPositions[point]));
        return height > kOffSpacings * spacing && height > kNoises * mNoise;
    }

private:
    const std::vector<Vec3f>& mPositions;
    const double mNoise;
    std::vector<std::uint32_t> mMembers;
};

constexpr std::size_t kReach = 6; // neighbors within a point's reach; [tuned: clean_points_test]

double reachIn(const Surroundings& surroundings)
{
    return surroundings.distance(kReach - 1);
}

/// Whether a point has its neighbors several times farther off than these have theirs.
class SparserPoint
{
public:
    SparserPoint(const std::vector<Vec3f>& positions, double noise, Surroundings& surroundings)
        : mPositions(positions), mNoise(noise), mSurroundings(surroundings)
    {
    }

    bool isSparser(std::uint32_t point)
    {
        while (mSurroundings.count() < kNeighbors ||
               mSurroundings.completeTo() <
                   mSurroundings.distance(kNeighbors - 1) + reachIn(mSurroundings) / kSparser)
            if (!mSurroundings.lookFarther()) break;
        if (mSurroundings.count() < kReach) return true;
        if (reachIn(mSurroundings) < kNoises * mNoise) return false;
        mMembers.clear(); // those that are like it: what it would be a surface with
        std::size_t closer = 0;
        for (std::size_t k = 0; k < std::min(kNeighbors, mSurroundings.count()); ++k)
            if (isCloser(mSurroundings.near(k)))
                ++closer;
            else
                mMembers.push_back(mSurroundings.near(k).point);
        if (closer <= kNeighbors / 4) return false;
        // Neighbors with which no plane is judged. [tuned: clean_points_test]
        constexpr std::size_t kFew = 5;
        return mMembers.size() < kFew ||
               !liesFlat(mPositions, point, mMembers, reachIn(mSurroundings));
    }

    /// Whether it lies on a sheet with those that surround it. What is denser about it is looked at
    /// as sparsely as the sheet would be that it belongs to.
    bool isOnSheet(std::uint32_t point)
    {
        // Spacings, each twice as large, at which a sheet is looked for. [tuned:
        // clean_points_test]
        constexpr int kScales = 4;
        if (mSurroundings.count() < kReach) return false;
        double apart = reachIn(mSurroundings) / 2;
        for (int scale = 0; scale < kScales; ++scale, apart *= 2) {
            thin(apart);
            while (mMembers.size() < kThinned || mFarthest > mSurroundings.completeTo()) {
                if (!mSurroundings.lookFarther()) break;
                thin(apart);
            }
            if (mMembers.size() < kThinned / 2) return false;
            if (isSurrounded(point)) return liesFlat(mPositions, point, mMembers, mFarthest);
        }
        return false;
    }

private:
    /// Neighbors that are compared, and those of a sheet at one scale. [tuned: clean_points_test]
    static constexpr std::size_t kNeighbors = 16, kThinned = 12;
    /// The ratio of a point's reach to that of its neighbors from which it is sparser. [tuned:
    /// clean_points_test]
    static constexpr double kSparser = 2.5;

    /// Whether a neighbor has its own several times closer.
    bool isCloser(const Surroundings::Near& neighbor) const
    {
        const Vec3f& p = mPositions[neighbor.point];
        const double close = reachIn(mSurroundings) / kSparser;
        const double farthest = std::sqrt(double(neighbor.squared)) + close;
        std::size_t near = 0;
        for (std::size_t k = 0; k < mSurroundings.count(); ++k) {
            const Surroundings::Near& n = mSurroundings.near(k);
            if (n.squared > farthest * farthest) break;
            near += n.point != neighbor.point &&
                    (mPositions[n.point] - p).squaredNorm() <= close * close;
            if (near == kReach) return true;
        }
        return false;
    }

    /// Members are the nearest that are no nearer to each other than @a apart.
    void thin(double apart)
    {
        mMembers.clear();
        mFarthest = 0;
        for (std::size_t k = 0; k < mSurroundings.count() && mMembers.size() < kThinned; ++k) {
            const Vec3f& p = mPositions[mSurroundings.near(k).point];
            const bool isApart =
                std::all_of(mMembers.begin(), mMembers.end(), [&](std::uint32_t m) {
                    return (mPositions[m] - p).squaredNorm() >= apart * apart;
                });
            if (!isApart) continue;
            mMembers.push_back(mSurroundings.near(k).point);
            mFarthest = mSurroundings.distance(k);
        }
    }

    /// Whether the members are on all sides of it, seen along their plane's normal: beyond the edge
    /// of a face nothing is.
    bool isSurrounded(std::uint32_t point)
    {
        // The widest angle without a member, radians. [tuned: clean_points_test; at the edge of a
        // face it is 180 degrees]
        constexpr double kWidestGap = 150 * M_PI / 180;
        const Vec3d normal = planeOf(mPositions, mMembers).normal;
        const Vec3d u = normal.unitOrthogonal(), v = normal.cross(u);
        mAngles.clear();
        for (const std::uint32_t m : mMembers) {
            const Vec3d d = (mPositions[m] - mPositions[point]).cast<double>();
            mAngles.push_back(std::atan2(d.dot(v), d.dot(u)));
        }
        std::sort(mAngles.begin(), mAngles.end());
        double widest = mAngles.front() + 2 * M_PI - mAngles.back();
        for (std::size_t k = 1; k < mAngles.size(); ++k)
            widest = std::max(widest, mAngles[k] - mAngles[k - 1]);
        return widest < kWidestGap;
    }

    const std::vector<Vec3f>& mPositions;
    const double mNoise;
    Surroundings& mSurroundings;
    std::vector<std::uint32_t> mMembers;
    double mFarthest = 0; // member's distance
    std::vector<double> mAngles;
};

/// Whether a surface goes on from a point to its neighbors as their normals and its own say.
class NormalsLead
{
public:
    /// @param normals  unit length; or none, which lead nowhere.
    NormalsLead(const std::vector<Vec3f>& positions, const std::vector<Vec3f>& normals,
                Surroundings& surroundings)
        : mPositions(positions), mNormals(normals), mSurroundings(surroundings)
    {
    }

    bool leadTo(std::uint32_t point)
    {
        return !mNormals.empty() && (agreeAround(point) || agreeOnItsSide(point));
    }

private:
    /// The way from one point of an arc to another is perpendicular to the mean of the normals.
    bool agree(std::uint32_t point, std::uint32_t other) const
    {
        const float kOff = std::sin(0.262f); // 15 degrees [tuned: clean_points_test]
        const Vec3f way = mPositions[other] - mPositions[point];
        const Vec3f sum = mNormals[other] + mNormals[point];
        return std::abs(way.dot(sum)) < kOff * way.norm() * sum.norm();
    }

    /// Most of those around, as those do that see the bottom of a fold from its walls.
    bool agreeAround(std::uint32_t point)
    {
        // Neighbors that are asked, and those that have to agree. [tuned: clean_points_test]
        constexpr std::size_t kAsked = 12, kAgreeing = 9;
        while (mSurroundings.count() < kAsked)
            if (!mSurroundings.lookFarther()) return false;
        std::size_t agreeing = 0;
        for (std::size_t k = 0; k < kAsked; ++k) {
            const std::uint32_t other = mSurroundings.near(k).point;
            agreeing += lookToOneSide(mNormals[point], mNormals[other]) && agree(point, other);
        }
        return agreeing >= kAgreeing;
    }

    /// Those that look to its side, about as far apart as it is from them: a face with few points
    /// beside one with many, which look elsewhere and have nothing to say.
    bool agreeOnItsSide(std::uint32_t point)
    {
        // Those of kReach neighbors that have to agree, and the distance of the first of them in
        // reaches. [tuned: clean_points_test]
        constexpr std::size_t kAgreeing = 5;
        constexpr double kFar = 1.5;
        // Neighbors within twice the distance of the farthest asked. [derived: of an even face
        // they are four times as many; half as many again where points lie at random]
        constexpr std::size_t kMost = 6 * kReach;
        while (mSurroundings.count() < kReach ||
               mSurroundings.completeTo() < 2 * kFar * reachIn(mSurroundings))
            if (!mSurroundings.lookFarther()) return false;
        double far = kFar * reachIn(mSurroundings);
        std::size_t asked = 0, agreeing = 0;
        for (std::size_t k = 0; k < mSurroundings.count() && mSurroundings.distance(k) < far; ++k) {
            if (!lookToOneSide(mNormals[point], mNormals[mSurroundings.near(k).point])) continue;
            if (++asked > kMost) return false;
            if (asked > kReach) continue;
            agreeing += agree(point, mSurroundings.near(k).point);
            if (asked == kReach) far = 2 * mSurroundings.distance(k);
        }
        return agreeing >= kAgreeing;
    }

    const std::vector<Vec3f>& mPositions;
    const std::vector<Vec3f>& mNormals;
    Surroundings& mSurroundings;
};

/// Judges the points of one cell after the other.
class LonePoints
{
public:
    LonePoints(const std::vector<Vec3f>& positions, const std::vector<Vec3f>& normals,
               const PointCells& cells, const PointStatistics& statistics,
               const std::vector<char>& flags)
        : mCells(cells), mStatistics(statistics), mSurroundings(positions, cells, flags),
          mOffPlane(positions, statistics.noise),
          mSparser(positions, statistics.noise, mSurroundings),
          mNormals(positions, normals, mSurroundings)
    {
    }

    void judge(std::uint32_t cell, std::vector<PointInCell>& found)
    {
        // Radii within which a point has neighbors, spacings. [tuned: clean_points_test; a disc of
        // the larger one holds thirty points of a surface, one of the smaller seven]
        constexpr double kFar = 3, kClose = 1.5;
        mSurroundings.enter(mCells.cells()[cell]);
        const double noise = kNoises * mStatistics.noise;
        const double far = std::min(std::max(kFar * mSurroundings.spacing(), noise), mCells.side());
        // What is off the plane by more than the noise has no neighbor at half of that either.
        const double close = std::max(kClose * mStatistics.spacing, noise / 2);
        for (std::size_t i = 0; i < mSurroundings.points().size(); ++i) {
            if (mSurroundings.hasNeighbors(i, int(kReach), far, close)) continue;
            const std::uint32_t p = mSurroundings.points()[i];
            if (!standsAlone(p, far, close)) continue;
            if (!mNormals.leadTo(p)) found.push_back({p, cell});
        }
    }

private:
    /// Whether its position is that of an outlier.
    bool standsAlone(std::uint32_t point, double far, double close)
    {
        mSurroundings.lookAbout(point, far);
        const auto isNoneWithin = [&](std::size_t k, double radius) {
            return mSurroundings.count() <= k || mSurroundings.distance(k) >= radius;
        };
        if (isNoneWithin(0, close) && mOffPlane.isOff(point, mSurroundings)) return true;
        if (!isNoneWithin(kReach - 1, far)) return false;
        return mSparser.isSparser(point) && !mSparser.isOnSheet(point);
    }

    const PointCells& mCells;
    const PointStatistics& mStatistics;
    Surroundings mSurroundings;
    OffPlane mOffPlane;
    SparserPoint mSparser;
    NormalsLead mNormals;
};

} // namespace

bool lookToOneSide(const Vec3f& a, const Vec3f& b)
{
    // The cosine between normals of one side. [tuned: clean_points_test]
    constexpr float kSameSide = 0.3f;
    return a.dot(b) > kSameSide;
}

void flagLonePoints(const std::vector<Vec3f>& positions, const std::vector<Vec3f>& normals,
                    const PointCells& cells, const std::vector<std::uint32_t>& asked,
                    const PointStatistics& statistics, std::vector<char>& flags,
                    Interrupter& progress)
{
    // Passes, since an outlier may hide another. [tuned: clean_points_test]
    constexpr int kPasses = 3;
    constexpr std::size_t kGrain = 64; // cells; [free: the same points are flagged]
    std::vector<std::uint32_t> left = asked;
    for (int pass = 0; pass < kPasses && !left.empty(); ++pass) {
        const auto judge = [&](std::size_t chunk, std::vector<PointInCell>& found) {
            LonePoints points(positions, normals, cells, statistics, flags);
            const std::size_t end = std::min((chunk + 1) * kGrain, left.size());
            for (std::size_t n = chunk * kGrain; n < end; ++n) points.judge(left[n], found);
        };
        const auto found =
            gatherParallel<PointInCell>((left.size() + kGrain - 1) / kGrain, 1, progress, judge);
        for (const PointInCell& lone : found) flags[lone.point] = 1;
        const std::vector<char> isAbout = cellsAbout(cells, found);
        left.clear();
        std::copy_if(asked.begin(), asked.end(), std::back_inserter(left),
                     [&](std::uint32_t c) { return isAbout[c]; });
    }
}

} // namespace mpuvdb
