// Solids that are inside out: their points close a surface, and all its normals look into it.
#include "core/parallel_each.h"
#include "oriented_parts.h"
#include "points/indexed.h"
#include "spatial/kd_tree.h"
#include "spatial/point_cells.h"

#include "core/union_find.h"
#include <mpuvdb/interrupter.h>
#include <mpuvdb/normals.h>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace mpuvdb
{
namespace
{

constexpr std::size_t kSolidGrain = 256; // cells; [free: the same parts]
/// The mean number of points in a pixel. [derived: none is empty by chance where points lie at
/// random]
constexpr double kPerPixel = 48;

/// The middles of the points in each cell.
std::vector<Vec3f> middlesOf(const PointCells& cells, Interrupter& progress)
{
    const PointIndex& index = cells.index();
    std::vector<Vec3f> middles(cells.cells().size());
    forEachParallel(middles.size(), kSolidGrain, progress, [&](std::size_t c) {
        const PointCells::Cell& cell = cells.cells()[c];
        const Vec3f base = index[cells.begin(cell)->begin];
        Vec3f sum = Vec3f::Zero();
        cells.forEachPoint(cell, [&](std::uint32_t n) { sum += index[n] - base; });
        middles[c] = base + sum / float(cell.size());
    });
    return middles;
}

/// Of each point the part that it belongs to. Cells hang together that are among each other's
/// nearest, however far apart: of parts of any spacing, a coarse one beside a fine one too.
std::vector<std::uint32_t> partsOf(const PointCells& cells, Interrupter& progress)
{
    constexpr std::size_t kNearest = 8; // [derived: those around a cell on a surface]
    const std::vector<Vec3f> middles = middlesOf(cells, progress);
    const std::size_t nearest = std::min(kNearest, middles.size() - 1);
    std::vector<std::uint32_t> near(middles.size() * nearest);
    const KdTree tree(middles);
    forEachParallel(middles.size(), kSolidGrain, progress, [&](std::size_t c) {
        std::vector<std::uint32_t> indices(nearest + 1);
        std::vector<float> squared(nearest + 1);
        tree.nearest(middles[c], indices, squared);
        const auto self = std::find(indices.begin(), indices.end(), std::uint32_t(c));
        indices.erase(self == indices.end() ? self - 1 : self);
        std::copy(indices.begin(), indices.end(), &near[c * nearest]);
    });
    const auto isNear = [&](std::uint32_t of, std::uint32_t c) {
        const auto* const begin = &near[of * nearest];
        return std::find(begin, begin + nearest, c) != begin + nearest;
    };
    UnionFind sets(middles.size());
    for (std::uint32_t c = 0; c < middles.size(); ++c)
        for (std::size_t k = 0; k < nearest; ++k) {
            const std::uint32_t other = near[c * nearest + k];
            if (k == 0 || isNear(other, c)) sets.join(c, other); // none stays alone
        }
    const std::vector<std::uint32_t>& order = cells.index().order();
    std::vector<std::uint32_t> parts(order.size());
    for (std::uint32_t c = 0; c < middles.size(); ++c) {
        const std::uint32_t part = sets.find(c);
        cells.forEachPoint(cells.cells()[c], [&](std::uint32_t n) { parts[order[n]] = part; });
    }
    return parts;
}

/// Parts as solids: which are closed, which lie in which, and which are inside out.
class Solids
{
public:
    explicit Solids(const OrientedParts& points) : mPoints(points), mParts(collectParts(points))
    {
        for (const Part& part : mParts) mSides.push_back(sideOf(part));
    }

    /// Of each part whether its normals have to be turned.
    std::vector<char> insideOut()
    {
        std::vector<char> turn(mParts.size(), 0);
        if (std::find(mSides.begin(), mSides.end(), Side::Inward) == mSides.end()) return turn;
        for (std::size_t p = 0; p < mParts.size(); ++p)
            if (isClosed(p)) mWindings.push_back({p, PartWinding(mParts[p], mPoints, false)});
        for (const Closed& c : mWindings) {
            const Closed& outermost = outermostAround(c);
            turn[c.part] = mSides[outermost.part] == Side::Inward && !isRoom(outermost);
        }
        turnRest(turn);
        return turn;
    }

    const std::vector<Part>& parts() const { return mParts; }

private:
    struct Closed {
        std::size_t part;
        PartWinding winding;
    };

    /// What a part shows to who looks at it from outside, if it is closed.
    enum class Side { Open, Outward, Inward };

    Side sideOf(const Part& part) const
    {
        // The fewest points of a closed part, which make eight pixels. [tuned: inward_solids_test]
        constexpr std::size_t kFewest = 400;
        // [derived: half of what a door of 0.9 x 2 opens of the walls of a room of 5 x 4 x 2.7;
        // InwardSolids comes out the same from 0.007 to 0.014]
        constexpr double kOpen = 0.01;
        // Less than 1, for single pixels between points. [tuned: InwardSolids; the same from 0.8 to
        // 0.95]
        constexpr double kAllAround = 0.9;
        if (part.points.size() < kFewest) return Side::Open;
        const Visibility seen = visibilityOf(part, mPoints, kPerPixel);
        if (std::abs(seen.facing) < kAllAround || seen.through > kOpen) return Side::Open;
        return seen.facing < 0 ? Side::Inward : Side::Outward;
    }
    bool isClosed(std::size_t part) const { return mSides[part] != Side::Open; }

    bool isWithin(std::size_t part, const Closed& other) const
    {
        return part != other.part && mParts[other.part].box.contains(mParts[part].box) &&
               liesWithin(mParts[part], other.winding, mPoints);
    }

    /// The closed part around a closed one that lies in no other.
    const Closed& outermostAround(const Closed& c) const
    {
        const Closed* outermost = &c;
        for (const Closed& other : mWindings)
            if (isWithin(outermost->part, other)) outermost = &other;
        return *outermost;
    }

    /// Whether things that are not closed, as scanners see those that stand before a wall, lie in
    /// what a closed part encloses: it then was seen from within.
    bool isRoom(const Closed& c) const
    {
        // Share of its points. [tuned: InwardSolids; at 0.03 a room with furniture is turned]
        constexpr double kFew = 0.01;
        double things = 0;
        for (std::size_t p = 0; p < mParts.size(); ++p)
            if (!isClosed(p) && isWithin(p, c)) things += double(mParts[p].points.size());
        return things > kFew * double(mParts[c.part].points.size());
    }

    /// Turn the open parts, where they are few, as most of the others.
    void turnRest(std::vector<char>& turn) const
    {
        // Share of all points. [tuned: InwardSolids; the same at 0.1]
        constexpr double kScraps = 0.05;
        double turned = 0, kept = 0, rest = 0;
        for (std::size_t p = 0; p < mParts.size(); ++p)
            (!isClosed(p) ? rest : turn[p] ? turned : kept) += double(mParts[p].points.size());
        if (rest > kScraps * (turned + kept + rest) || kept > kScraps * turned) return;
        for (std::size_t p = 0; p < mParts.size(); ++p) turn[p] = turn[p] || !isClosed(p);
    }

    const OrientedParts mPoints; // three references
    const std::vector<Part> mParts;
    std::vector<Side> mSides;
    std::vector<Closed> mWindings;
};

/// How much of what is seen of a whole cloud faces the viewers, see Visibility.
double facingOfAll(const PointCloud& cloud, const PointIndex& index)
{
    const std::vector<std::uint32_t> parts; // they are one
    return visibilityOf({index.order(), index.bounds()}, {cloud.positions, cloud.normals, parts},
                        kPerPixel)
        .facing;
}

} // namespace

std::vector<std::uint32_t> findInwardSolids(const PointCloud& cloud, const PointIndex& index,
                                            const PointStatistics& statistics,
                                            Interrupter& progress)
{
    std::vector<std::uint32_t> found;
    if (cloud.size() < 2) return found;
    const double facing = facingOfAll(cloud, index);
    if (cloud.mesh && cloud.mesh->insideOut && facing < 0) { // triangles know it best
        found.resize(cloud.size());
        std::iota(found.begin(), found.end(), 0u);
        return found;
    }
    // The facing of clouds that have no part to turn, as most are. [tuned: inward_solids_test]
    constexpr double kNoBack = 0.999;
    if (facing > kNoBack) return found;
    constexpr double kCellSpacings = 4; // [tuned: inward_solids_test]
    const PointCells cells(index, kCellSpacings * statistics.spacing, progress);
    if (cells.cells().size() < 2) return found;
    const std::vector<std::uint32_t> parts = partsOf(cells, progress);
    progress.check();
    Solids solids({cloud.positions, cloud.normals, parts});
    const std::vector<char> turn = solids.insideOut();
    for (std::size_t p = 0; p < turn.size(); ++p)
        if (turn[p])
            found.insert(found.end(), solids.parts()[p].points.begin(),
                         solids.parts()[p].points.end());
    std::sort(found.begin(), found.end());
    return found;
}

std::vector<std::uint32_t> findInwardSolids(const PointCloud& cloud,
                                            const PointStatistics& statistics,
                                            Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    if (cloud.empty() || !cloud.hasNormals()) return {};
    return findInwardSolids(cloud, *indexOf(cloud, progress), statistics, progress);
}

} // namespace mpuvdb
