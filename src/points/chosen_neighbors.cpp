#include "chosen_neighbors.h"

#include "core/parallel_each.h"
#include "core/random.h"
#include "spatial/kd_tree.h"
#include "spatial/position_order.h"

#include <mpuvdb/interrupter.h>

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <numeric>
#include <unordered_map>

namespace mpuvdb
{
namespace
{

constexpr std::size_t kChunk = 1 << 12; // points

void sortUnique(std::vector<Vec3f>& positions)
{
    std::sort(positions.begin(), positions.end(), positionBefore);
    positions.erase(std::unique(positions.begin(), positions.end()), positions.end());
}

std::uint64_t hashOf(const Vec3f& p)
{
    std::uint32_t bits[3];
    const Vec3f plain = p + Vec3f::Zero(); // -0 becomes 0
    std::memcpy(bits, plain.data(), sizeof bits);
    return mixBits(mixBits((std::uint64_t(bits[0]) << 32 | bits[1]) + 1) + bits[2]);
}

double squaredDistance(const Vec3f& a, const Vec3f& b)
{
    return (a.cast<double>() - b.cast<double>()).squaredNorm();
}

/// Radius of a ball about every chosen point that mostly holds k other points of all.
std::vector<double> guessRadii(const std::vector<Vec3f>& positions,
                               const std::vector<Vec3f>& chosen, std::size_t k,
                               Interrupter& progress)
{
    // A finer cloud takes longer to sort, a coarser one makes balls that hold far too much.
    constexpr std::size_t kMany = 32768, kThinning = 40, kThinningOfFew = 4;
    const std::size_t size =
        std::max(std::min(kMany, positions.size() / kThinningOfFew), positions.size() / kThinning);
    std::vector<Vec3f> thinned = choosePositions(positions, size, progress);
    if (thinned.empty()) thinned = chosen; // many copies of a few positions
    const double expected =
        double(k) * std::min(1.0, double(thinned.size()) / double(positions.size()));
    const auto wanted = std::size_t(expected + 2 * std::sqrt(expected) + 3);
    const KdTree tree(thinned);
    std::vector<double> radii(chosen.size());
    tbb::parallel_for(std::size_t(0), chosen.size(), [&](std::size_t i) {
        progress.check();
        std::vector<std::uint32_t> indices(wanted);
        std::vector<float> squared(wanted);
        tree.nearest(chosen[i], indices, squared);
        // Rounded up: what is at this distance itself belongs to the ball.
        radii[i] = 1.001 * std::sqrt(double(squared.back()));
    });
    return radii;
}

/// The balls of many centers, in grids of several cell sizes: a ball stands in the cells that it
/// meets of the grid whose cells are one to two radii wide.
class BallGrids
{
public:
    BallGrids(const std::vector<Vec3f>& centers, const std::vector<double>& radii,
              const std::vector<std::uint32_t>& members)
        : mCenters(centers), mRadii(radii)
    {
        for (const std::uint32_t m : members) insert(m);
    }

    /// Calls visit(member) for each ball that @a p lies in.
    template <class Visit>
    void forBallsAt(const Vec3f& p, Visit&& visit) const
    {
        for (const Grid& grid : mGrids) {
            const std::uint64_t key = keyOf(grid.cellOf(p.cast<double>()));
            if (!grid.marks[markOf(key)]) continue;
            const auto found = grid.cells.find(key);
            if (found == grid.cells.end()) continue;
            for (const std::uint32_t m : found->second)
                if (squaredDistance(p, mCenters[m]) <= mRadii[m] * mRadii[m]) visit(m);
        }
    }

private:
    using Cell = Eigen::Matrix<std::int64_t, 3, 1>;
    static constexpr int kMarkBits = 18;

    struct Grid {
        explicit Grid(int e) : exponent(e), cellsPerUnit(std::ldexp(1.0, -e)), marks(1 << kMarkBits)
        {
        }
        Cell cellOf(const Vec3d& p) const { return {cellAt(p.x()), cellAt(p.y()), cellAt(p.z())}; }
        /// The floor, without the call that it is where no instruction may be assumed for it.
        std::int64_t cellAt(double x) const
        {
            // A ball of next to no radius may stand far out in its cells.
            constexpr double kFarthest = 1e15;
            const double scaled = std::min(std::max(x * cellsPerUnit, -kFarthest), kFarthest);
            const auto towardsZero = std::int64_t(scaled);
            return towardsZero - (scaled < double(towardsZero));
        }

        int exponent;
        double cellsPerUnit;
        std::vector<bool> marks; ///< by markOf(): whether the cell may be in the map
        std::unordered_map<std::uint64_t, std::vector<std::uint32_t>> cells;
    };

    /// 21 bits per axis; cells that share a key only cost a comparison.
    static std::uint64_t keyOf(const Cell& c)
    {
        constexpr std::uint64_t kMask = (1u << 21) - 1;
        return (std::uint64_t(c.x()) & kMask) << 42 | (std::uint64_t(c.y()) & kMask) << 21 |
               (std::uint64_t(c.z()) & kMask);
    }
    static std::size_t markOf(std::uint64_t key)
    {
        return (key * 0x9e3779b97f4a7c15u) >> (64 - kMarkBits);
    }

    void insert(std::uint32_t m)
    {
        const double radius = std::max(mRadii[m], 1e-30);
        Grid& grid = gridFor(int(std::ceil(std::log2(radius))));
        const Vec3d center = mCenters[m].cast<double>();
        const Cell low = grid.cellOf(center.array() - radius);
        const Cell high = grid.cellOf(center.array() + radius);
        Cell c;
        for (c.x() = low.x(); c.x() <= high.x(); ++c.x())
            for (c.y() = low.y(); c.y() <= high.y(); ++c.y())
                for (c.z() = low.z(); c.z() <= high.z(); ++c.z()) {
                    const std::uint64_t key = keyOf(c);
                    grid.marks[markOf(key)] = true;
                    grid.cells[key].push_back(m);
                }
    }

    Grid& gridFor(int exponent)
    {
        for (Grid& g : mGrids)
            if (g.exponent == exponent) return g;
        return mGrids.emplace_back(exponent);
    }

    const std::vector<Vec3f>& mCenters;
    const std::vector<double>& mRadii;
    std::vector<Grid> mGrids;
};

/// Order of points whose positions may coincide.
bool neighborBefore(const Neighbor& a, const Neighbor& b)
{
    if (a.squaredDistance != b.squaredDistance) return a.squaredDistance < b.squaredDistance;
    return a.position != b.position ? positionBefore(a.position, b.position)
                                    : positionBefore(a.normal, b.normal);
}

/// Put into each member's neighborhood all positions of its ball but its own, sorted.
void collect(const PointCloud& cloud, const std::vector<Vec3f>& chosen,
             const std::vector<double>& radii, const std::vector<std::uint32_t>& members,
             std::vector<Neighborhood>& neighborhoods, Interrupter& progress)
{
    struct Hit {
        std::uint32_t member, point;
    };
    const std::vector<Vec3f>& positions = cloud.positions;
    const BallGrids grids(chosen, radii, members);
    const auto findHits = [&](std::size_t i, std::vector<Hit>& hits) {
        grids.forBallsAt(positions[i], [&](std::uint32_t m) {
            hits.push_back({m, std::uint32_t(i)});
        });
    };
    for (const std::uint32_t m : members) neighborhoods[m].neighbors.clear();
    for (const Hit& h : gatherParallel<Hit>(positions.size(), kChunk, progress, findHits)) {
        const Vec3f& p = positions[h.point];
        const Vec3f normal = cloud.hasNormals() ? cloud.normals[h.point] : Vec3f::Zero();
        neighborhoods[h.member].neighbors.push_back(
            {p, normal, squaredDistance(p, chosen[h.member])});
    }
    tbb::parallel_for(std::size_t(0), members.size(), [&](std::size_t i) {
        Neighborhood& n = neighborhoods[members[i]];
        std::sort(n.neighbors.begin(), n.neighbors.end(), neighborBefore);
        const auto same = [](const Neighbor& a, const Neighbor& b) {
            return a.position == b.position;
        };
        n.neighbors.erase(std::unique(n.neighbors.begin(), n.neighbors.end(), same),
                          n.neighbors.end());
        n.normal = n.neighbors.front().normal; // the nearest is the chosen point itself
        n.neighbors.erase(n.neighbors.begin());
    });
}

} // namespace

std::vector<Vec3f> choosePositions(const std::vector<Vec3f>& positions, std::size_t count,
                                   Interrupter& progress)
{
    std::vector<Vec3f> chosen;
    double share = double(count) / double(std::max<std::size_t>(positions.size(), 1));
    // Many duplicates can leave few: then a larger share, up to all.
    for (bool enough = false; !enough; share *= 8) {
        const bool all = share >= 1;
        const std::uint64_t limit = all ? 0 : std::uint64_t(share * 0x1p64);
        const auto choose = [&](std::size_t i, std::vector<Vec3f>& found) {
            if (all || hashOf(positions[i]) < limit) found.push_back(positions[i]);
        };
        chosen = gatherParallel<Vec3f>(positions.size(), kChunk, progress, choose);
        sortUnique(chosen);
        enough = all || chosen.size() >= count / 4;
    }
    return chosen;
}

std::vector<Neighborhood> nearestOfChosen(const PointCloud& cloud, const std::vector<Vec3f>& chosen,
                                          std::size_t k, Interrupter& progress)
{
    const std::vector<Vec3f>& positions = cloud.positions;
    std::vector<Neighborhood> neighborhoods(chosen.size());
    for (std::size_t i = 0; i < chosen.size(); ++i) neighborhoods[i].center = chosen[i];
    std::vector<double> radii = guessRadii(positions, chosen, k, progress);
    std::vector<std::uint32_t> members(chosen.size());
    std::iota(members.begin(), members.end(), 0u);
    Box3d box;
    for (const Vec3f& p : positions) box.extend(p.cast<double>());
    const double everything = 1.001 * box.diagonal().norm();
    while (!members.empty()) {
        collect(cloud, chosen, radii, members, neighborhoods, progress);
        std::vector<std::uint32_t> poor;
        for (const std::uint32_t m : members) {
            if (neighborhoods[m].neighbors.size() >= k || radii[m] >= everything) continue;
            poor.push_back(m);
            radii[m] = std::max(2 * radii[m], 1e-6 * everything);
        }
        members = std::move(poor);
    }
    for (Neighborhood& n : neighborhoods)
        if (n.neighbors.size() > k) n.neighbors.resize(k);
    return neighborhoods;
}

} // namespace mpuvdb
