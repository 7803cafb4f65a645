#include "polygons.h"

#include "core/parallel_each.h"

#include <algorithm>
#include <utility>

namespace mpuvdb
{
namespace
{

using Triangle = Triangles::value_type;

bool isBefore(const Vec3d& a, const Vec3d& b)
{
    return std::lexicographical_compare(a.data(), a.data() + 3, b.data(), b.data() + 3);
}

/// Cuts ears off a polygon, until three corners are left.
class EarCutter
{
public:
    /// @param fan  the polygon's triangles, all at its first corner; replaced.
    EarCutter(Triangle* fan, std::size_t count, const std::vector<Vec3d>& positions)
        : mTriangles(fan), mCount(count), mPositions(positions), mCorners{fan[0][0], fan[0][1]}
    {
        for (std::size_t t = 0; t < count; ++t) mCorners.push_back(fan[t][2]);
    }

    void cut(const Interrupter& progress)
    {
        for (std::size_t k = 0; k < mCorners.size(); ++k)
            if (!at(k).allFinite()) return;
        findNormal();
        const std::size_t n = mCorners.size();
        mNext.resize(n);
        mLast.resize(n);
        for (std::size_t k = 0; k < n; ++k) {
            mNext[k] = (k + 1) % n;
            mLast[k] = (k + n - 1) % n;
        }
        for (std::size_t k = 0; k < n; ++k)
            if (!(turnAt(k) > 0)) mReflex.push_back(k);
        mEars.resize(n);
        for (std::size_t k = 0; k < n; ++k) mEars[k] = earAt(k);
        std::size_t left = n - 1; // a corner that is left
        for (std::size_t t = 0; t + 1 < mCount; ++t) {
            progress.check();
            const std::size_t ear = bestFrom(left);
            left = mLast[ear];
            write(t, ear);
            mNext[mLast[ear]] = mNext[ear];
            mLast[mNext[ear]] = mLast[ear];
            mReflex.erase(std::remove_if(mReflex.begin(), mReflex.end(),
                                         [&](std::size_t k) { return k == ear || turnAt(k) > 0; }),
                          mReflex.end());
            for (const std::size_t k : {mLast[ear], mNext[ear]}) mEars[k] = earAt(k);
        }
        write(mCount - 1, left);
    }

private:
    /// What is cut off at a corner.
    struct Ear {
        bool isWithin;   ///< the diagonal is, as far as corners say
        double diagonal; ///< its length squared
        Vec3d low, high; ///< its ends

        bool isBetterThan(const Ear& o) const
        {
            if (isWithin != o.isWithin) return isWithin;
            if (diagonal != o.diagonal) return diagonal < o.diagonal;
            if (low != o.low) return isBefore(low, o.low);
            return isBefore(high, o.high);
        }
    };

    const Vec3d& at(std::size_t k) const { return mPositions[mCorners[k]]; }

    /// The normal, about which the polygon turns counter-clockwise. [Newell: the area vector]
    void findNormal()
    {
        mNormal.setZero();
        for (std::size_t k = 2; k < mCorners.size(); ++k)
            mNormal += (at(k - 1) - at(0)).cross(at(k) - at(0));
    }

    static double turn(const Vec3d& normal, const Vec3d& a, const Vec3d& b, const Vec3d& c)
    {
        return normal.dot((b - a).cross(c - b));
    }
    double turnAt(std::size_t k) const { return turn(mNormal, at(mLast[k]), at(k), at(mNext[k])); }

    Ear earAt(std::size_t k) const
    {
        const Vec3d &a = at(mLast[k]), &b = at(k), &c = at(mNext[k]);
        const bool isInOrder = isBefore(a, c);
        Ear ear{turnAt(k) > 0, (c - a).squaredNorm(), isInOrder ? a : c, isInOrder ? c : a};
        // Corners that turn inward are the first to reach into a triangle of others.
        for (std::size_t n = 0; n < mReflex.size() && ear.isWithin; ++n) {
            const Vec3d& p = at(mReflex[n]);
            if (p == a || p == b || p == c) continue;
            ear.isWithin = turn(mNormal, a, b, p) < 0 || turn(mNormal, b, c, p) < 0 ||
                           turn(mNormal, c, a, p) < 0;
        }
        return ear;
    }

    /// The best of the corners that are left, of which @a first is one.
    std::size_t bestFrom(std::size_t first)
    {
        std::size_t best = first;
        for (std::size_t k = mNext[first]; k != first; k = mNext[k])
            if (mEars[k].isBetterThan(mEars[best])) best = k;
        if (mEars[best].isWithin || mIsCrossed) return best;
        // What reached into them may have been cut off; else the polygon crosses itself.
        for (std::size_t k = mNext[first];; k = mNext[k]) {
            mEars[k] = earAt(k);
            if (mEars[k].isBetterThan(mEars[best])) best = k;
            if (k == first) break;
        }
        mIsCrossed = !mEars[best].isWithin;
        return best;
    }

    void write(std::size_t t, std::size_t ear)
    {
        mTriangles[t] = {mCorners[mLast[ear]], mCorners[ear], mCorners[mNext[ear]]};
    }

    Triangle* mTriangles;
    std::size_t mCount; ///< of triangles
    const std::vector<Vec3d>& mPositions;
    std::vector<std::uint32_t> mCorners;
    Vec3d mNormal;
    std::vector<std::size_t> mNext, mLast; ///< neighbors among the corners that are left
    std::vector<std::size_t> mReflex;      ///< corners left that turn inward, or not at all
    std::vector<Ear> mEars;                ///< by corner
    bool mIsCrossed = false;               ///< no diagonal lies within
};

} // namespace

void Faces::append(const std::vector<std::int64_t>& corners)
{
    const auto at = [&](std::size_t i) { return std::uint32_t(corners[i]); };
    if (corners.size() > 3)
        polygons.push_back({std::uint32_t(triangles.size()), std::uint32_t(corners.size() - 2)});
    for (std::size_t i = 2; i < corners.size(); ++i) triangles.push_back({at(0), at(i - 1), at(i)});
}

void Faces::append(Faces&& other)
{
    const auto first = std::uint32_t(triangles.size());
    for (const Polygon& polygon : other.polygons)
        polygons.push_back({first + polygon.first, polygon.count});
    triangles.insert(triangles.end(), other.triangles.begin(), other.triangles.end());
}

Triangles cutPolygons(Faces&& faces, const std::vector<Vec3d>& positions, Interrupter& progress)
{
    constexpr std::size_t kGrain = 256; ///< polygons of a task [free: the same triangles]
    forEachParallel(faces.polygons.size(), kGrain, progress, [&](std::size_t n) {
        const Faces::Polygon& polygon = faces.polygons[n];
        EarCutter(&faces.triangles[polygon.first], polygon.count, positions).cut(progress);
    });
    return std::move(faces.triangles);
}

} // namespace mpuvdb
