#include "outward.h"

#include <mpuvdb/progress.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace mpuvdb
{
namespace
{

/// The points of a part and the box about them.
struct Part {
    std::vector<std::uint32_t> points;
    Eigen::AlignedBox3f box;
};

/// What is seen from one side of a part: the foremost point of each pixel.
class View
{
public:
    View(const Eigen::AlignedBox3f& box, std::size_t points, int axis, float side)
        : mBox(box), mAxis(axis), mSide(side)
    {
        // Pixels of several points, so that one does not see through a surface.
        constexpr double kPointsPerPixel = 12;
        constexpr int kMost = 32;
        mWidth = std::clamp(int(std::sqrt(double(points) / kPointsPerPixel)), 1, kMost);
        mForemost.resize(std::size_t(mWidth * mWidth));
    }

    void add(const Vec3f& position, const Vec3f& normal)
    {
        const float depth = mSide * position[mAxis];
        Seen& seen = mForemost[std::size_t(column(position, 1) * mWidth + column(position, 2))];
        if (!(depth > seen.depth)) return;
        seen.depth = depth;
        seen.facing = mSide * normal[mAxis];
    }

    /// Sum over the pixels of how much what is seen faces the viewer: from -1 each to 1.
    double vote() const
    {
        double sum = 0;
        for (const Seen& seen : mForemost) sum += double(seen.facing);
        return sum;
    }

private:
    struct Seen {
        float depth = -std::numeric_limits<float>::infinity();
        float facing = 0;
    };

    int column(const Vec3f& p, int turn) const
    {
        const int axis = (mAxis + turn) % 3;
        const float size = std::max(mBox.sizes()[axis], std::numeric_limits<float>::min());
        return std::min(int((p[axis] - mBox.min()[axis]) / size * float(mWidth)), mWidth - 1);
    }

    Eigen::AlignedBox3f mBox;
    int mAxis, mWidth = 1;
    float mSide;
    std::vector<Seen> mForemost;
};

bool seenInward(const Part& part, const OrientedParts& points)
{
    double vote = 0;
    for (int axis = 0; axis < 3; ++axis)
        for (const float side : {-1.f, 1.f}) {
            View view(part.box, part.points.size(), axis, side);
            for (const std::uint32_t i : part.points)
                view.add(points.positions[i], points.normals[i]);
            vote += view.vote();
        }
    return vote < 0;
}

/// A part's surface as one dipole for each cell of a coarse grid.
class Winding
{
public:
    Winding(const Part& part, const OrientedParts& points, bool turned)
    {
        constexpr int kCells = 24;
        const float cell =
            std::max(part.box.sizes().maxCoeff() / kCells, std::numeric_limits<float>::min());
        std::vector<std::uint32_t> dipoleOf(kCells * kCells * kCells, ~0u);
        for (const std::uint32_t i : part.points) {
            const Vec3i at =
                ((points.positions[i] - part.box.min()) / cell).cast<int>().cwiseMin(kCells - 1);
            std::uint32_t& d = dipoleOf[std::size_t((at.x() * kCells + at.y()) * kCells + at.z())];
            if (d == ~0u) {
                d = std::uint32_t(mDipoles.size());
                mDipoles.emplace_back();
            }
            mDipoles[d].position += points.positions[i].cast<double>();
            mDipoles[d].normal += points.normals[i].cast<double>();
            mDipoles[d].points += 1;
        }
        // A surface covers about the same area in every cell that it meets; a plane of any
        // direction two thirds of a face on average.
        const double area = 2.0 / 3 * double(cell) * double(cell);
        for (Dipole& d : mDipoles) {
            d.position /= d.points;
            d.normal *= (turned ? -area : area) / d.points;
        }
        mSoftening = area / (2 * M_PI);
        mCell = double(cell);
    }

    /// About 1 or -1 within a closed part, 0 without.
    double at(const Vec3d& p) const
    {
        double sum = 0;
        for (const Dipole& d : mDipoles) {
            const Vec3d apart = d.position - p;
            const double squared = apart.squaredNorm() + mSoftening; // a disc, not a point
            sum += apart.dot(d.normal) / (squared * std::sqrt(squared));
        }
        return sum / (4 * M_PI);
    }

    double cell() const { return mCell; }

private:
    struct Dipole {
        Vec3d position = Vec3d::Zero(), normal = Vec3d::Zero();
        double points = 0;
    };
    std::vector<Dipole> mDipoles;
    double mSoftening = 0, mCell = 0;
};

/// Calls f(position, normal) for a few points of a part.
template <class F>
void forAFew(const Part& part, const OrientedParts& points, F&& f)
{
    constexpr std::size_t kAsked = 64;
    const std::size_t asked = std::min(kAsked, part.points.size());
    for (std::size_t k = 0; k < asked; ++k) {
        const std::uint32_t i = part.points[k * part.points.size() / asked];
        f(points.positions[i].cast<double>(), points.normals[i].cast<double>());
    }
}

/// Decides part after part, the largest first; smaller ones see what is decided.
class PartTurner
{
public:
    PartTurner(const std::vector<Part>& parts, const OrientedParts& points)
        : mParts(parts), mPoints(points)
    {
    }

    bool isInward(std::size_t part)
    {
        bool nested = false;
        double drop = 0;
        for (const Decided& d : mDecided) {
            const Part& other = mParts[d.part];
            if (other.box.intersection(mParts[part].box).isEmpty()) continue;
            nested ^= other.box.contains(mParts[part].box) && liesWithin(part, d.winding);
            drop += dropAcross(part, d.winding);
        }
        constexpr double kClearly = 0.25; // of the 1 that a closed surface's number drops by
        const bool inward =
            std::abs(drop) > kClearly ? drop < 0 : seenInward(mParts[part], mPoints) != nested;
        constexpr std::size_t kFewestPoints = 100, kMost = 64; // few are soon asked
        if (mParts[part].points.size() >= kFewestPoints && mDecided.size() < kMost)
            mDecided.push_back({part, Winding(mParts[part], mPoints, inward)});
        return inward;
    }

private:
    struct Decided {
        std::size_t part;
        Winding winding;
    };

    /// Whether most of a few points of a part lie within a closed one.
    bool liesWithin(std::size_t inner, const Winding& outer) const
    {
        int votes = 0;
        forAFew(mParts[inner], mPoints, [&](const Vec3d& p, const Vec3d&) {
            votes += std::abs(outer.at(p)) > 0.5 ? 1 : -1;
        });
        return votes > 0;
    }

    /// How much the winding number of another part drops from behind a part's points to before
    /// them: where the part fills a gap of the other, or lies on it, positive if it looks outward.
    double dropAcross(std::size_t part, const Winding& other) const
    {
        double drop = 0, count = 0;
        forAFew(mParts[part], mPoints, [&](const Vec3d& p, const Vec3d& normal) {
            const Vec3d step = other.cell() / 2 * normal;
            drop += other.at(p - step) - other.at(p + step);
            count += 1;
        });
        return drop / count;
    }

    const std::vector<Part>& mParts;
    const OrientedParts& mPoints;
    std::vector<Decided> mDecided;
};

/// One more than the last part.
std::size_t partEnd(const OrientedParts& points)
{
    const auto last = std::max_element(points.parts.begin(), points.parts.end());
    return last == points.parts.end() ? 0 : std::size_t(*last) + 1;
}

std::vector<Part> collectParts(const OrientedParts& points)
{
    std::vector<Part> parts;
    std::vector<std::uint32_t> placeOf(partEnd(points), ~0u);
    for (std::uint32_t i = 0; i < points.positions.size(); ++i) {
        std::uint32_t& place = placeOf[points.parts[i]];
        if (place == ~0u) {
            place = std::uint32_t(parts.size());
            parts.emplace_back();
        }
        parts[place].points.push_back(i);
        parts[place].box.extend(points.positions[i]);
    }
    return parts;
}

} // namespace

std::vector<char> findInwardParts(const OrientedParts& points, Progress& progress)
{
    const std::vector<Part> parts = collectParts(points);
    std::vector<std::size_t> largestFirst(parts.size());
    std::iota(largestFirst.begin(), largestFirst.end(), std::size_t(0));
    std::stable_sort(largestFirst.begin(), largestFirst.end(), [&](std::size_t x, std::size_t y) {
        return parts[x].points.size() > parts[y].points.size();
    });
    PartTurner turner(parts, points);
    std::vector<char> inward(partEnd(points), 0);
    for (const std::size_t p : largestFirst) {
        progress.check();
        inward[points.parts[parts[p].points.front()]] = turner.isInward(p);
    }
    return inward;
}

} // namespace mpuvdb
