#include "oriented_parts.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace mpuvdb
{
namespace
{

/// What is seen from one side of a part: the foremost point of each pixel.
class View
{
public:
    View(const Eigen::AlignedBox3f& box, float pixel, int axis, float side)
        : mBox(box), mAxis(axis), mSide(side), mPixel(pixel), mWidth(pixels(1)), mHeight(pixels(2))
    {
        mForemost.resize(std::size_t(mWidth) * std::size_t(mHeight));
    }

    /// The pixel of a position, in the views from both sides.
    std::size_t pixelAt(const Vec3f& position) const
    {
        return place(column(position, 1), column(position, 2));
    }
    void add(std::size_t pixel, const Vec3f& position, const Vec3f& normal)
    {
        const float depth = mSide * position[mAxis];
        Seen& seen = mForemost[pixel];
        if (!(depth > seen.depth)) return;
        seen.depth = depth;
        seen.facing = mSide * normal[mAxis];
    }

    /// Sums over pixels of how much what is seen faces the viewer, without its sign.
    struct Sums {
        double front = 0, back = 0;           ///< of those that show their front, and their back
        double frontSpots = 0, backSpots = 0; ///< of those in spots of such
    };

    void sumUp(Sums& sums) const
    {
        for (int x = 0; x < mWidth; ++x)
            for (int y = 0; y < mHeight; ++y) {
                const auto facing = double(at(x, y).facing);
                (facing > 0 ? sums.front : sums.back) += std::abs(facing);
                if (isInSpot(x, y))
                    (facing > 0 ? sums.frontSpots : sums.backSpots) += std::abs(facing);
            }
    }

private:
    struct Seen {
        float depth = -std::numeric_limits<float>::infinity();
        float facing = 0;
    };

    std::size_t place(int x, int y) const
    {
        return std::size_t(x) * std::size_t(mHeight) + std::size_t(y);
    }
    const Seen& at(int x, int y) const { return mForemost[place(x, y)]; }

    /// Whether one of the four squares of four pixels that a pixel is in shows one side. Of few
    /// pixels each counts.
    bool isInSpot(int x, int y) const
    {
        constexpr int kFew = 256; // pixels; [tuned: inward_solids_test]
        if (mWidth * mHeight < kFew) return true;
        for (const int dx : {-1, 1})
            for (const int dy : {-1, 1}) {
                const int i = x + dx, j = y + dy;
                if (i < 0 || j < 0 || i >= mWidth || j >= mHeight) continue;
                const float side = at(x, y).facing;
                if (side * at(i, y).facing > 0 && side * at(x, j).facing > 0 &&
                    side * at(i, j).facing > 0)
                    return true;
            }
        return false;
    }

    /// Along the axis @a turn after the viewer's.
    int pixels(int turn) const
    {
        return std::max(int(mBox.sizes()[(mAxis + turn) % 3] / mPixel), 1);
    }

    int column(const Vec3f& p, int turn) const
    {
        const int axis = (mAxis + turn) % 3, most = turn == 1 ? mWidth : mHeight;
        const float size = std::max(mBox.sizes()[axis], std::numeric_limits<float>::min());
        return std::min(int((p[axis] - mBox.min()[axis]) / size * float(most)), most - 1);
    }

    Eigen::AlignedBox3f mBox;
    int mAxis;
    float mSide, mPixel;
    int mWidth, mHeight;
    std::vector<Seen> mForemost;
};

/// The side of a pixel over which @a perPixel points lie, if they lie evenly on the part's box.
float pixelOf(const Part& part, double perPixel)
{
    constexpr float kMost = 32; // along the longest side; [tuned: inward_solids_test]
    const Vec3f size = part.box.sizes();
    const float face = (size.x() * size.y() + size.y() * size.z() + size.z() * size.x()) / 3;
    const float even = std::sqrt(float(perPixel / double(part.points.size())) * face);
    return std::max({even, size.maxCoeff() / kMost, std::numeric_limits<float>::min()});
}

} // namespace

Eigen::AlignedBox3f boxOf(const std::vector<std::uint32_t>& some, const OrientedParts& points)
{
    Eigen::AlignedBox3f box;
    for (const std::uint32_t i : some) box.extend(points.positions[i]);
    return box;
}

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

Visibility visibilityOf(const Part& part, const OrientedParts& points, double perPixel)
{
    View::Sums sums;
    const float pixel = pixelOf(part, perPixel);
    for (int axis = 0; axis < 3; ++axis) {
        View low(part.box, pixel, axis, -1), high(part.box, pixel, axis, 1);
        for (const std::uint32_t i : part.points) {
            const std::size_t at = low.pixelAt(points.positions[i]);
            low.add(at, points.positions[i], points.normals[i]);
            high.add(at, points.positions[i], points.normals[i]);
        }
        low.sumUp(sums);
        high.sumUp(sums);
    }
    const double all = sums.front + sums.back;
    if (!(all > 0)) return {};
    return {(sums.front - sums.back) / all,
            (sums.front > sums.back ? sums.backSpots : sums.frontSpots) / all};
}

PartWinding::PartWinding(const Part& part, const OrientedParts& points, bool turned)
{
    // Along the longest side. [tuned: contour_normals_test; time grows with their squares]
    constexpr int kFewestCells = 4, kMostCells = 24;
    const int cells = std::clamp(int(std::sqrt(double(part.points.size()) / kPointsPerCell)),
                                 kFewestCells, kMostCells);
    const float cell =
        std::max(part.box.sizes().maxCoeff() / float(cells), std::numeric_limits<float>::min());
    std::vector<std::uint32_t> dipoleOf(std::size_t(std::pow(cells, 3)), ~0u);
    for (const std::uint32_t i : part.points) {
        const Vec3i at =
            ((points.positions[i] - part.box.min()) / cell).cast<int>().cwiseMin(cells - 1);
        const int place = (at.x() * cells + at.y()) * cells + at.z();
        std::uint32_t& d = dipoleOf[std::size_t(place)];
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
    mCell = double(cell);
    const double area = 2.0 / 3 * mCell * mCell;
    for (Dipole& d : mDipoles) {
        d.position /= d.points;
        d.normal *= (turned ? -area : area) / d.points;
    }
    mArea = area * double(mDipoles.size());
    mSoftening = area / (2 * M_PI);
}

double PartWinding::at(const Vec3d& p) const
{
    double sum = 0;
    for (const Dipole& d : mDipoles) {
        const Vec3d apart = d.position - p;
        const double squared = apart.squaredNorm() + mSoftening; // a disc, not a point
        sum += apart.dot(d.normal) / (squared * std::sqrt(squared));
    }
    return sum / (4 * M_PI);
}

std::vector<double> PartWinding::on(const Part& part, const OrientedParts& points) const
{
    std::vector<double> values;
    forAFew(part, points, [&](const Vec3d& p, const Vec3d&) { values.push_back(at(p)); });
    return values;
}

bool liesWithin(const Part& inner, const PartWinding& outer, const OrientedParts& points)
{
    int votes = 0;
    for (const double number : outer.on(inner, points)) votes += std::abs(number) > 0.5 ? 1 : -1;
    return votes > 0;
}

} // namespace mpuvdb
