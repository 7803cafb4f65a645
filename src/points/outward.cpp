#include "outward.h"

#include <mpuvdb/progress.h>

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

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
    Winding(const Part& part, const OrientedParts& points)
    {
        constexpr int kCells = 16;
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
            d.normal *= area / d.points;
        }
        mSoftening = area / (2 * M_PI);
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

private:
    struct Dipole {
        Vec3d position = Vec3d::Zero(), normal = Vec3d::Zero();
        double points = 0;
    };
    std::vector<Dipole> mDipoles;
    double mSoftening = 0;
};

/// Whether most of a few points of @a inner lie within @a outer.
bool liesWithin(const Part& inner, const Winding& outer, const OrientedParts& points)
{
    constexpr std::size_t kAsked = 15;
    constexpr double kInside = 0.5;
    const std::size_t asked = std::min(kAsked, inner.points.size());
    std::size_t within = 0;
    for (std::size_t k = 0; k < asked; ++k) {
        const std::uint32_t i = inner.points[k * inner.points.size() / asked];
        within += std::abs(outer.at(points.positions[i].cast<double>())) > kInside;
    }
    return 2 * within > asked;
}

std::vector<Part> collectParts(const OrientedParts& points)
{
    std::vector<Part> parts;
    std::vector<std::uint32_t> placeOf(points.positions.size(), ~0u);
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

/// The parts that others may lie in: the largest, at most as many as are soon asked.
std::vector<std::size_t> largestParts(const std::vector<Part>& parts)
{
    constexpr std::size_t kFewestPoints = 100, kMostParts = 64;
    std::vector<std::size_t> large;
    for (std::size_t p = 0; p < parts.size(); ++p)
        if (parts[p].points.size() >= kFewestPoints) large.push_back(p);
    std::stable_sort(large.begin(), large.end(), [&](std::size_t x, std::size_t y) {
        return parts[x].points.size() > parts[y].points.size();
    });
    if (large.size() > kMostParts) large.resize(kMostParts);
    return large;
}

/// Which parts lie within an odd number of others.
std::vector<char> findNested(const std::vector<Part>& parts, const OrientedParts& points,
                             Progress& progress)
{
    std::vector<char> nested(parts.size(), 0);
    for (const std::size_t outer : largestParts(parts)) {
        progress.check();
        std::vector<std::size_t> boxed;
        for (std::size_t inner = 0; inner < parts.size(); ++inner)
            if (inner != outer && parts[outer].box.contains(parts[inner].box))
                boxed.push_back(inner);
        if (boxed.empty()) continue;
        const Winding winding(parts[outer], points);
        tbb::parallel_for(std::size_t(0), boxed.size(), [&](std::size_t k) {
            progress.check();
            nested[boxed[k]] ^= char(liesWithin(parts[boxed[k]], winding, points));
        });
    }
    return nested;
}

} // namespace

std::vector<char> findInwardParts(const OrientedParts& points, Progress& progress)
{
    const std::vector<Part> parts = collectParts(points);
    std::vector<char> inward(parts.size(), 0);
    tbb::parallel_for(std::size_t(0), parts.size(), [&](std::size_t p) {
        progress.check();
        inward[p] = seenInward(parts[p], points);
    });
    const std::vector<char> nested = findNested(parts, points, progress);
    std::vector<char> result(points.positions.size(), 0);
    for (std::size_t p = 0; p < parts.size(); ++p)
        result[points.parts[parts[p].points.front()]] = inward[p] != nested[p];
    return result;
}

} // namespace mpuvdb
