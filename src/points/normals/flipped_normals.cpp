// Normals that look the wrong way. A screen finds the cells of a grid whose normals disagree: there
// each point asks its neighbors. Then cells are compared with cells, to find whole patches.
#include "core/parallel_each.h"
#include "orientation.h"
#include "outward.h"
#include "points/indexed.h"
#include "spatial/point_cells.h"

#include "core/union_find.h"
#include <mpuvdb/interrupter.h>
#include <mpuvdb/normals.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>

namespace mpuvdb
{
namespace
{

constexpr double kCellSpacings = 5; // [tuned: clean_points_test]
/// The distance of voters, spacings; no more than a cell. [tuned: clean_points_test]
constexpr double kReachSpacings = 3;
/// The standard deviations by which points of a plane may be off it. [derived: 19 of 20 lie within]
constexpr double kNoises = 2;
constexpr std::size_t kFlipGrain = 256; // cells; [free: the same normals]
/// The share of flipped normals from which on voters may be wrong. [tuned: clean_points_test]
constexpr double kMany = 0.015;

/// The cloud's normals, some of them turned.
class TurnedNormals
{
public:
    explicit TurnedNormals(const PointCloud& cloud) : mCloud(cloud), mTurned(cloud.size(), 0) {}

    Vec3f normal(std::uint32_t i) const
    {
        return mTurned[i] ? -mCloud.normals[i] : mCloud.normals[i];
    }
    bool turned(std::uint32_t i) const { return mTurned[i] != 0; }
    void turn(std::uint32_t i) { mTurned[i] ^= 1; }

private:
    const PointCloud& mCloud;
    std::vector<char> mTurned;
};

/// Single flipped normals: those that most neighbors in their plane look away from.
class Vote
{
public:
    Vote(const PointCells& cells, const PointStatistics& statistics, TurnedNormals& normals)
        : mCells(cells), mNormals(normals), mReach(float(kReachSpacings * statistics.spacing)),
          mScatter(float(std::pow(kNoises * statistics.noise, 2)))
    {
    }

    /// @return how often one was turned.
    std::size_t run(Interrupter& progress)
    {
        const std::vector<std::uint32_t> mixed = mixedCells(progress);
        std::size_t turned = turnOutvoted(mixed, kClear, progress);
        // Where many are flipped, fewer voters are right.
        if (double(turned) > kMany * double(mCells.index().size()))
            turned += turnOutvoted(mixed, kHardly, progress);
        return turned;
    }

private:
    /// The balance of votes, as a part of them, from which on a normal is turned. [tuned:
    /// clean_points_test; on a thin part voters of the other side are in the majority now and then,
    /// but not clearly]
    static constexpr float kClear = -0.5f, kHardly = -0.35f;

    /// Rounds until none is turned: where every fifth is flipped, some are not outvoted at first.
    std::size_t turnOutvoted(const std::vector<std::uint32_t>& cells, float against,
                             Interrupter& progress)
    {
        constexpr int kRounds = 8; // [tuned: clean_points_test]
        std::size_t turned = 0;
        std::vector<std::uint32_t> asked = cells;
        for (int round = 0; round < kRounds && !asked.empty(); ++round) {
            const auto outvoted = gatherParallel<PointInCell>(
                asked.size(), kFlipGrain, progress,
                [&](std::size_t n, auto& found) { ask(asked[n], against, found); });
            turned += outvoted.size();
            for (const PointInCell& found : outvoted) mNormals.turn(found.point);
            const std::vector<char> isAbout = cellsAbout(mCells, outvoted);
            asked.clear();
            std::copy_if(cells.begin(), cells.end(), std::back_inserter(asked),
                         [&](std::uint32_t c) { return isAbout[c]; });
        }
        return turned;
    }

    /// Cells with normals that look opposite ways.
    std::vector<std::uint32_t> mixedCells(Interrupter& progress) const
    {
        const auto findMixed = [&](std::size_t c, std::vector<std::uint32_t>& mixed) {
            if (isMixed(mCells.cells()[c])) mixed.push_back(std::uint32_t(c));
        };
        return gatherParallel<std::uint32_t>(mCells.cells().size(), kFlipGrain, progress,
                                             findMixed);
    }

    bool isMixed(const PointCells::Cell& cell) const
    {
        // The cosine from which on normals are along each other; others are across. [tuned:
        // clean_points_test]
        constexpr float kAlong = 0.5f;
        // [derived: no two are 120 degrees apart where all are within 60 of one, less rounding]
        constexpr float kAlike = 0.5001f;
        const std::vector<std::uint32_t>& order = mCells.index().order();
        const Vec3f one = mNormals.normal(order[mCells.begin(cell)->begin]);
        bool alike = true;
        mCells.forEachPoint(
            cell, [&](std::uint32_t n) { alike &= one.dot(mNormals.normal(order[n])) > kAlike; });
        if (alike) return false;
        constexpr std::size_t kFaces = 3; // [derived: of a corner]
        std::array<Vec3f, kFaces> faces;  // normals across each other, as at a corner
        std::size_t known = 0;
        for (const std::uint32_t n : mCells.byPosition(cell)) {
            const Vec3f normal = mNormals.normal(order[n]);
            std::size_t f = 0;
            for (; f < known; ++f) {
                const float cosine = faces[f].dot(normal);
                if (cosine < -kAlong) return true;
                if (cosine > kAlong) break;
            }
            if (f == known && known < kFaces) faces[known++] = normal;
        }
        return false;
    }

    struct Voter {
        Vec3f position;
        std::uint32_t point;
    };

    void ask(std::uint32_t c, float against, std::vector<PointInCell>& outvoted) const
    {
        const PointCells::Cell& cell = mCells.cells()[c];
        std::vector<Voter> around;
        const auto add = [&](const PointCells::Cell& from) {
            mCells.forEachPoint(from, [&](std::uint32_t n) {
                around.push_back({mCells.index()[n], mCells.index().order()[n]});
            });
        };
        add(cell);
        mCells.forEachAround(cell, [&](std::uint32_t n) { add(mCells.cells()[n]); });
        for (std::size_t n = 0; n < cell.size(); ++n)
            if (isOutvoted(around[n], around, against)) outvoted.push_back({around[n].point, c});
    }

    bool isOutvoted(const Voter& judged, const std::vector<Voter>& around, float against) const
    {
        // Other sheets lie above and below a cone about the point's plane. [tuned:
        // clean_points_test]
        constexpr float kSlope = 0.3f;
        constexpr float kFewest = 5; // votes; [tuned: clean_points_test]
        const Vec3f normal = mNormals.normal(judged.point);
        float votes = 0, voters = 0;
        for (const auto& [position, q] : around) {
            const Vec3f apart = position - judged.position;
            const float squared = apart.squaredNorm();
            const float height = normal.dot(apart);
            if (squared > mReach * mReach || height * height > kSlope * kSlope * squared + mScatter)
                continue;
            if (q == judged.point) continue;
            // One across an edge has nothing to say.
            const float vote = normal.dot(mNormals.normal(q));
            votes += vote;
            voters += std::abs(vote);
        }
        return voters >= kFewest && votes < against * voters;
    }

    const PointCells& mCells;
    TurnedNormals& mNormals;
    float mReach;
    float mScatter; ///< squared height that noise gives points of a plane
};

/// The points of a cell that look to about the same side.
struct Patchlet {
    Vec3f position = Vec3f::Zero(); ///< middle
    Vec3f normal = Vec3f::Zero();   ///< mean, unit
    std::uint32_t points = 0;
};

/// Whole patches: patchlets that neighbors, and theirs, say must be turned.
class Patches
{
public:
    /// @param voted  how many were turned before.
    Patches(const PointCells& cells, const PointStatistics& statistics, std::size_t voted,
            TurnedNormals& normals, Interrupter& progress)
        : mCells(cells), mNoise(float(statistics.noise)),
          mSheet(float(statistics.spacing / 5 + statistics.noise)), mVoted(double(voted)),
          mNormals(normals), mProgress(progress)
    {
        mPatchlets.resize(2 * cells.cells().size());
        forEachParallel(cells.cells().size(), kFlipGrain, progress,
                        [&](std::size_t c) { average(c); });
    }

    void run()
    {
        const std::vector<OrientationLink> links = findLinks();
        // Where no two disagree there is nothing to solve.
        constexpr float kClearly = -0.3f; // vote; [tuned: clean_points_test]
        if (std::none_of(links.begin(), links.end(),
                         [](const OrientationLink& l) { return l.vote < kClearly; }))
            return;
        std::vector<char> turn = solve(links);
        confirm(links, turn);
        std::vector<std::uint32_t> turning; // at the end: a cell's first normal decides its sides
        for (std::uint32_t n = 0; n < mPatchlets.size(); ++n)
            if (turn[n]) forEachPoint(n, [&](std::uint32_t point) { turning.push_back(point); });
        for (const std::uint32_t point : turning) mNormals.turn(point);
    }

private:
    /// Call f(place, side) for the points of a cell: side is 1 where a normal looks elsewhere than
    /// that of the cell's first point, whose patchlet is the even one.
    template <class F>
    void forEachOfCell(const PointCells::Cell& cell, F&& f) const
    {
        const std::vector<std::uint32_t>& order = mCells.index().order();
        const Vec3f first = mNormals.normal(order[mCells.firstOf(cell)]);
        mCells.forEachPoint(cell, [&](std::uint32_t n) {
            f(n, std::uint32_t(first.dot(mNormals.normal(order[n])) < kAlike));
        });
    }

    template <class F>
    void forEachPoint(std::uint32_t patchlet, F&& f) const
    {
        forEachOfCell(mCells.cells()[patchlet / 2], [&](std::uint32_t n, std::uint32_t side) {
            if (side == patchlet % 2) f(mCells.index().order()[n]);
        });
    }

    void average(std::size_t c)
    {
        // The length of the mean normal. [tuned: clean_points_test]
        constexpr float kPure = 0.8f;
        const PointCells::Cell& cell = mCells.cells()[c];
        const Vec3f base = mCells.center(cell).cast<float>();
        forEachOfCell(cell, [&](std::uint32_t n, std::uint32_t side) {
            Patchlet& patchlet = mPatchlets[2 * c + side];
            patchlet.position += mCells.index()[n] - base;
            patchlet.normal += mNormals.normal(mCells.index().order()[n]);
            ++patchlet.points;
        });
        for (std::size_t side = 0; side < 2; ++side) {
            Patchlet& patchlet = mPatchlets[2 * c + side];
            if (patchlet.points == 0) continue;
            patchlet.position = base + patchlet.position / float(patchlet.points);
            // What looks many ways, as at a thin wall's rim, says nothing.
            if (patchlet.normal.norm() < kPure * float(patchlet.points))
                patchlet.points = 0;
            else
                patchlet.normal.normalize();
        }
    }

    std::vector<OrientationLink> findLinks() const
    {
        const auto linkCell = [&](std::size_t c, std::vector<OrientationLink>& links) {
            const auto first = std::uint32_t(2 * c), second = first + 1;
            link(first, second, links);
            mCells.forFacesAfter(mCells.cells()[c], [&](std::uint32_t other) {
                for (const std::uint32_t side : {first, second}) linkToSheet(side, other, links);
            });
        };
        return gatherParallel<OrientationLink>(mCells.cells().size(), kFlipGrain, mProgress,
                                               linkCell);
    }

    /// Heights of two patchlets over each other's planes.
    float heights(std::uint32_t a, std::uint32_t b) const
    {
        const Patchlet &from = mPatchlets[a], &to = mPatchlets[b];
        const Vec3f apart = to.position - from.position;
        return std::max(std::abs(from.normal.dot(apart)), std::abs(to.normal.dot(apart)));
    }

    /// Whether opposite normals are rightly so: each patchlet lies behind the other, or each before
    /// it. On one curved sheet, one lies before and one behind.
    bool areTwoSheets(const Patchlet& from, const Patchlet& to) const
    {
        constexpr float kOpposite = -0.5f; // cosine; [tuned: clean_points_test]
        const Vec3f apart = to.position - from.position;
        return from.normal.dot(to.normal) < kOpposite &&
               std::abs((to.normal - from.normal).dot(apart)) > 2 * mSheet;
    }

    /// Link a patchlet to the one of another cell that is rather on its sheet. A floor that meets a
    /// wall lies before one of its sides and behind the other; the patchlets' mean positions do not
    /// tell which. So where a cell holds both sides of a wall, only patchlets that go on are
    /// linked.
    void linkToSheet(std::uint32_t a, std::uint32_t cell, std::vector<OrientationLink>& links) const
    {
        std::uint32_t b = 2 * cell;
        if (mPatchlets[a].points == 0) return;
        if (mPatchlets[b + 1].points > 0 && heights(a, b + 1) < heights(a, b)) ++b;
        const auto isOfWall = [&](std::uint32_t n) {
            return mPatchlets[n ^ 1].points > 0 && areTwoSheets(mPatchlets[n], mPatchlets[n ^ 1]);
        };
        const bool goesOn = std::abs(mPatchlets[a].normal.dot(mPatchlets[b].normal)) > kAlike;
        if (goesOn || !(isOfWall(a) || isOfWall(b))) link(a, b, links);
    }

    void link(std::uint32_t a, std::uint32_t b, std::vector<OrientationLink>& links) const
    {
        const Patchlet &from = mPatchlets[a], &to = mPatchlets[b];
        if (from.points == 0 || to.points == 0) return;
        if (areTwoSheets(from, to)) {
            links.push_back(linkAcrossSheets(a, b, from.normal, to.normal));
            return;
        }
        links.push_back(
            orientationLink(a, b, to.position - from.position, from.normal, to.normal, mNoise));
    }

    /// What each patchlet would have to be turned: in each part the fewer, or, where both are many,
    /// those that then look inward.
    std::vector<char> solve(const std::vector<OrientationLink>& links) const
    {
        constexpr std::uint64_t kClearly = 4; // to one; [tuned: clean_points_test]
        const Orientation found = solveOrientation(mPatchlets.size(), links, mProgress);
        struct Part {
            std::uint64_t points = 0, turned = 0;
        };
        std::vector<Part> parts(mPatchlets.size());
        for (std::uint32_t n = 0; n < mPatchlets.size(); ++n) {
            Part& part = parts[found.parts[n]];
            part.points += mPatchlets[n].points;
            if (found.turned[n]) part.turned += mPatchlets[n].points;
        }
        const std::vector<char> inward = inwardParts(found);
        std::vector<char> turn(mPatchlets.size(), 0);
        for (std::uint32_t n = 0; n < mPatchlets.size(); ++n) {
            if (mPatchlets[n].points == 0) continue;
            const Part& part = parts[found.parts[n]];
            const std::uint64_t kept = part.points - part.turned;
            bool others = inward[found.parts[n]];
            if (kept > kClearly * part.turned) others = false;
            if (part.turned > kClearly * kept) others = true;
            turn[n] = bool(found.turned[n]) != others;
        }
        return turn;
    }

    /// Whether parts look inward when their patchlets agree and the lowest is left as it is.
    std::vector<char> inwardParts(const Orientation& found) const
    {
        std::vector<Vec3f> positions, normals;
        std::vector<std::uint32_t> parts;
        for (std::uint32_t n = 0; n < mPatchlets.size(); ++n) {
            const Patchlet& p = mPatchlets[n];
            if (p.points == 0) continue;
            positions.push_back(p.position);
            normals.push_back(found.turned[n] ? Vec3f(-p.normal) : p.normal);
            parts.push_back(found.parts[n]);
        }
        return findInwardParts({positions, normals, parts}, mProgress);
    }

    /// Patchlets to turn together, and how those around take them as they are.
    struct Group {
        double points = 0, against = 0, all = 0;

        /// Clearly disagreed with, and all along: rims, folds and thin parts disagree too, but at
        /// a few places. A disc of n points has some 8 sqrt(n) points in the cells of its border.
        bool isFlipped() const
        {
            // The share of the links, the votes for each point of the border, and points. [tuned:
            // clean_points_test]
            constexpr double kDisagree = 0.6, kBorder = 2, kFewest = 20;
            return points >= kFewest && against >= kDisagree * all &&
                   against >= kBorder * std::sqrt(points);
        }
        /// Whether it is a small rest, as remains where many were flipped.
        bool isRest() const
        {
            // The share of the links, and points. [tuned: clean_points_test]
            constexpr double kDisagree = 0.3, kMost = 200;
            return points <= kMost && against > kDisagree * all;
        }
    };

    /// Keep only those groups of patchlets to turn that are flipped beyond doubt.
    void confirm(const std::vector<OrientationLink>& links, std::vector<char>& turn) const
    {
        UnionFind sets(mPatchlets.size());
        for (const OrientationLink& l : links)
            if (turn[l.a] && turn[l.b]) sets.join(l.a, l.b);
        std::vector<Group> groups(mPatchlets.size());
        for (std::uint32_t n = 0; n < turn.size(); ++n)
            if (turn[n]) groups[sets.find(n)].points += mPatchlets[n].points;
        for (const OrientationLink& l : links) {
            if (turn[l.a] == turn[l.b]) continue;
            Group& group = groups[sets.find(turn[l.a] ? l.a : l.b)];
            const double weight = std::min(mPatchlets[l.a].points, mPatchlets[l.b].points);
            group.against -= weight * l.vote;
            group.all += weight * std::abs(l.vote);
        }
        double flipped = mVoted;
        for (const Group& group : groups)
            if (group.isFlipped()) flipped += group.points;
        const bool many = flipped > kMany * double(mCells.index().size());
        for (std::uint32_t n = 0; n < turn.size(); ++n) {
            const Group& group = groups[sets.find(n)];
            turn[n] = turn[n] && (group.isFlipped() || (many && group.isRest()));
        }
    }

    const PointCells& mCells;
    static constexpr float kAlike = 0.5f; ///< cosine; [tuned: clean_points_test]

    const float mNoise;
    const float mSheet; // height that one sheet may have over a cell
    const double mVoted;
    TurnedNormals& mNormals;
    Interrupter& mProgress;
    std::vector<Patchlet> mPatchlets; // two of each cell
};

} // namespace

double sideForFlipped(const PointStatistics& statistics)
{
    return kCellSpacings * statistics.spacing;
}

std::vector<std::uint32_t> findFlippedNormals(const PointCloud& cloud, const PointCells& cells,
                                              const PointStatistics& statistics,
                                              Interrupter& progress)
{
    std::vector<std::uint32_t> flipped;
    TurnedNormals normals(cloud);
    const std::size_t voted = Vote(cells, statistics, normals).run(progress);
    Patches(cells, statistics, voted, normals, progress).run();
    for (std::uint32_t i = 0; i < cloud.size(); ++i)
        if (normals.turned(i)) flipped.push_back(i);
    return flipped;
}

std::vector<std::uint32_t> findFlippedNormals(const PointCloud& cloud,
                                              const PointStatistics& statistics,
                                              Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    if (cloud.empty() || !cloud.hasNormals()) return {};
    const std::shared_ptr<const PointIndex> index = indexOf(cloud, progress);
    const PointCells cells(*index, sideForFlipped(statistics), progress);
    return findFlippedNormals(cloud, cells, statistics, progress);
}

void flipNormals(PointCloud& cloud, const std::vector<std::uint32_t>& indices)
{
    for (const std::uint32_t i : indices) cloud.normals[i] = -cloud.normals[i];
}

} // namespace mpuvdb
