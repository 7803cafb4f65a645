// Whole patches of flipped normals, by a graph: a node for each cell whose normals, and those of
// the cells around, are alike, and one for each point of the other cells. On a thin part all cells
// hold both its sides; there only points tell which neighbors are of one sheet.
#include "flipped_patches.h"

#include "core/parallel_each.h"
#include "core/union_find.h"
#include "orientation.h"
#include "outward.h"
#include "spatial/kd_tree.h"
#include "spatial/point_cells.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

constexpr std::size_t kPatchGrain = 256; // cells, points; [free: the same patches]
/// The cosine from which on normals are those of one sheet, or of two that look opposite ways.
/// [derived: no two are 120 degrees apart where all are within 60 of one]
constexpr float kOneSheet = 0.5f;

/// The points of a cell whose normals are alike, or a point.
struct SheetNode {
    Vec3f position = Vec3f::Zero(); ///< middle
    Vec3f normal = Vec3f::Zero();   ///< mean, unit
    std::uint32_t points = 0;
};

/// Nodes, and what pairs of neighbors say about each other's normals. Links that are sure are of
/// one sheet; those that say nothing are kept, as a border is judged by all its pairs.
struct SheetGraph {
    std::vector<SheetNode> nodes;
    std::vector<std::uint32_t> nodeOf; ///< of each place of the index
    std::vector<OrientationLink> links;

    /// The pairs of points that a link stands for: of two cells that meet, one for each point.
    double pairsOf(const OrientationLink& link) const
    {
        return std::min(nodes[link.a].points, nodes[link.b].points);
    }
};

/// What two neighbors say: of one sheet, by their normals; of two faces of an edge, that each lies
/// behind the other or each before it. Of two sheets nothing: they rightly look opposite ways.
OrientationLink linkOf(std::uint32_t a, std::uint32_t b, const Vec3f& apart, const Vec3f& normalA,
                       const Vec3f& normalB, float noise)
{
    // The weight of an edge. [tuned: clean_points_test; 0.1 is as good, and 0 is not]
    constexpr float kAtEdge = 0.25f;
    const float cosine = normalA.dot(normalB);
    const bool inA = liesInPlane(apart, normalA, noise), inB = liesInPlane(apart, normalB, noise);
    OrientationLink link;
    link.a = std::min(a, b);
    link.b = std::max(a, b);
    link.unsure = std::abs(cosine) < kOneSheet || !inA || !inB;
    if (!link.unsure)
        link.vote = cosine;
    else if (std::abs(cosine) < kOneSheet && !inA && !inB)
        link.vote = std::copysign(kAtEdge, -normalA.dot(apart) * normalB.dot(apart));
    return link;
}

/// The cells of points with their normals as they are.
class SheetCells
{
public:
    SheetCells(const PointCells& cells, float noise, const TurnedNormals& normals)
        : mCells(cells), mNoise(noise), mNormals(normals)
    {
    }

    const PointCells& cells() const { return mCells; }
    float noise() const { return mNoise; }
    Vec3f normalAt(std::uint32_t place) const
    {
        return mNormals.normal(mCells.index().order()[place]);
    }
    Vec3f positionAt(std::uint32_t place) const { return mCells.index()[place]; }
    Vec3f firstNormal(const PointCells::Cell& cell) const { return normalAt(mCells.firstOf(cell)); }

    /// Whether all of a cell's normals look to about one side.
    bool isAlike(const PointCells::Cell& cell) const
    {
        const Vec3f first = firstNormal(cell);
        bool alike = true;
        mCells.forEachPoint(cell,
                            [&](std::uint32_t n) { alike &= first.dot(normalAt(n)) > kOneSheet; });
        return alike;
    }

    /// Whether a good part of the near points of a cell, or of it and one beside it, that lie in
    /// each other's planes look opposite ways, as they do at the border of a patch.
    bool disagrees(const PointCells::Cell& cell) const
    {
        const std::vector<std::uint32_t> own = someOf(cell);
        bool found = disagree(own, own);
        mCells.forFacesAfter(cell, [&](std::uint32_t other) {
            found = found || disagree(own, someOf(mCells.cells()[other]));
        });
        return found;
    }

private:
    /// A few points of a cell, evenly among all.
    std::vector<std::uint32_t> someOf(const PointCells::Cell& cell) const
    {
        // [derived: eight of each side of a thin part tell half of them from one]
        constexpr std::uint32_t kSome = 16;
        std::vector<std::uint32_t> some;
        std::uint32_t k = 0;
        mCells.forEachPoint(cell, [&](std::uint32_t n) {
            if (k++ % (cell.size() / kSome + 1) == 0) some.push_back(n);
        });
        return some;
    }

    bool disagree(const std::vector<std::uint32_t>& some,
                  const std::vector<std::uint32_t>& others) const
    {
        // Sides of a cell. [derived: the three spacings in which voters are asked]
        constexpr double kNear = 0.6;
        // The share of the pairs. [derived: above the quarter that one of eight makes, below the
        // half that a border through their middle does]
        constexpr double kBorder = 1.0 / 3;
        constexpr double kFewest = 4; // pairs. [derived: a quarter of what such a border has]
        const auto near2 = float(std::pow(kNear * mCells.side(), 2));
        double pairs = 0, against = 0;
        for (const std::uint32_t n : some)
            for (const std::uint32_t other : others) {
                const Vec3f apart = positionAt(other) - positionAt(n);
                if (n == other || apart.squaredNorm() > near2) continue;
                const float vote =
                    linkOf(n, other, apart, normalAt(n), normalAt(other), mNoise).vote;
                pairs += vote != 0 ? 1 : 0;
                against += vote < 0 ? 1 : 0;
            }
        return against >= kFewest && against > kBorder * pairs;
    }

    const PointCells& mCells;
    const float mNoise;
    const TurnedNormals& mNormals;
};

/// Whether there may be a patch's border. @param alike  of each cell.
bool anyBorder(const SheetCells& sheets, const std::vector<char>& alike, Interrupter& progress)
{
    const std::vector<PointCells::Cell>& cells = sheets.cells().cells();
    return !gatherParallel<std::uint32_t>(cells.size(), kPatchGrain, progress,
                                          [&](std::size_t c, std::vector<std::uint32_t>& found) {
                                              if (!alike[c] && sheets.disagrees(cells[c]))
                                                  found.push_back(std::uint32_t(c));
                                          })
                .empty();
}

/// Makes a graph.
class SheetGrapher
{
public:
    /// @param alike  of each cell.
    SheetGrapher(const SheetCells& sheets, const std::vector<char>& alike, Interrupter& progress)
        : mSheets(sheets), mCells(sheets.cells()), mProgress(progress)
    {
        findNodeCells(alike);
    }

    SheetGraph graph()
    {
        addNodes();
        mGraph.links = gatherParallel<OrientationLink>(
            mCells.cells().size(), kPatchGrain, mProgress,
            [&](std::size_t c, auto& links) { linkCell(std::uint32_t(c), links); });
        linkPoints();
        return std::move(mGraph);
    }

private:
    void findNodeCells(const std::vector<char>& alike)
    {
        const std::vector<PointCells::Cell>& cells = mCells.cells();
        mIsNode.resize(cells.size());
        forEachParallel(cells.size(), kPatchGrain, mProgress, [&](std::size_t c) {
            const Vec3f normal = mSheets.firstNormal(cells[c]);
            bool all = alike[c];
            mCells.forEachAround(cells[c], [&](std::uint32_t other) {
                all = all && alike[other] &&
                      normal.dot(mSheets.firstNormal(cells[other])) > kOneSheet;
            });
            mIsNode[c] = all ? 1 : 0;
        });
    }

    void addNodes()
    {
        const std::vector<PointCells::Cell>& cells = mCells.cells();
        std::vector<std::uint32_t> firsts(cells.size() + 1, 0);
        for (std::size_t c = 0; c < cells.size(); ++c)
            firsts[c + 1] = firsts[c] + (mIsNode[c] ? 1 : cells[c].size());
        mGraph.nodes.resize(firsts.back());
        mGraph.nodeOf.resize(mCells.index().size());
        forEachParallel(cells.size(), kPatchGrain, mProgress, [&](std::size_t c) {
            std::uint32_t node = firsts[c];
            mCells.forEachPoint(cells[c], [&](std::uint32_t n) {
                mGraph.nodeOf[n] = node;
                if (mIsNode[c])
                    mGraph.nodes[node].points = cells[c].size();
                else
                    mGraph.nodes[node++] = {mSheets.positionAt(n), mSheets.normalAt(n), 1};
            });
            if (mIsNode[c]) average(cells[c], mGraph.nodes[node]);
        });
    }

    void average(const PointCells::Cell& cell, SheetNode& node) const
    {
        const Vec3f base = mCells.center(cell).cast<float>();
        mCells.forEachPoint(cell, [&](std::uint32_t n) {
            node.position += mSheets.positionAt(n) - base;
            node.normal += mSheets.normalAt(n);
        });
        node.position = base + node.position / float(cell.size());
        node.normal.normalize();
    }

    std::uint32_t nodeOf(std::uint32_t cell) const
    {
        return mGraph.nodeOf[mCells.begin(mCells.cells()[cell])->begin];
    }

    /// Link a cell that is a node to those that share a face with it and are of its sheet: their
    /// middles do not tell which way an edge turns.
    void linkCell(std::uint32_t c, std::vector<OrientationLink>& links) const
    {
        if (!mIsNode[c]) return;
        mCells.forFacesAfter(mCells.cells()[c], [&](std::uint32_t other) {
            if (!mIsNode[other]) return;
            const std::uint32_t a = nodeOf(c), b = nodeOf(other);
            const SheetNode &from = mGraph.nodes[a], &to = mGraph.nodes[b];
            const OrientationLink link =
                linkOf(a, b, to.position - from.position, from.normal, to.normal, mSheets.noise());
            if (!link.unsure) links.push_back(link);
        });
    }

    /// The places of points that are nodes; and of those in the cells around, which are asked too.
    void collect(std::vector<std::uint32_t>& asking, std::vector<std::uint32_t>& asked) const
    {
        const std::vector<PointCells::Cell>& cells = mCells.cells();
        std::vector<char> isAsked(cells.size(), 0);
        for (std::size_t c = 0; c < cells.size(); ++c) {
            if (mIsNode[c]) continue;
            isAsked[c] = 1;
            mCells.forEachAround(cells[c], [&](std::uint32_t other) { isAsked[other] = 1; });
        }
        for (std::size_t c = 0; c < cells.size(); ++c)
            mCells.forEachPoint(cells[c], [&](std::uint32_t n) {
                if (!mIsNode[c]) asking.push_back(n);
                if (isAsked[c]) asked.push_back(n);
            });
    }

    /// Link points that are nodes to those of their nearest neighbors.
    void linkPoints()
    {
        // Neighbors of a point. [derived: six about it, and as many of the other side of a thin
        // part; with 18 and 28 the same]
        constexpr std::size_t kNeighbors = 12;
        std::vector<std::uint32_t> asking, asked;
        collect(asking, asked);
        std::vector<Vec3f> positions(asked.size());
        for (std::size_t k = 0; k < asked.size(); ++k) positions[k] = mSheets.positionAt(asked[k]);
        const KdTree tree(positions);
        const auto linkPoint = [&](std::size_t k, std::vector<OrientationLink>& links) {
            std::vector<std::uint32_t> nearest(kNeighbors + 1);
            std::vector<float> squared(kNeighbors + 1);
            const std::uint32_t a = mGraph.nodeOf[asking[k]];
            const SheetNode& from = mGraph.nodes[a];
            tree.nearest(from.position, nearest, squared);
            for (const std::uint32_t found : nearest) {
                const std::uint32_t b = mGraph.nodeOf[asked[found]];
                const Vec3f apart = positions[found] - from.position;
                if (apart.squaredNorm() > 0)
                    links.push_back(linkOf(a, b, apart, from.normal, mSheets.normalAt(asked[found]),
                                           mSheets.noise()));
            }
        };
        const auto links =
            gatherParallel<OrientationLink>(asking.size(), kPatchGrain, mProgress, linkPoint);
        mGraph.links.insert(mGraph.links.end(), links.begin(), links.end());
    }

    const SheetCells& mSheets;
    const PointCells& mCells;
    Interrupter& mProgress;
    SheetGraph mGraph;
    std::vector<char> mIsNode; ///< of each cell: it and those around are alike
};

/// Whether parts look inward when their nodes agree and the lowest is left as it is.
std::vector<char> inwardParts(const SheetGraph& graph, const Orientation& found,
                              Interrupter& progress)
{
    std::vector<Vec3f> positions, normals;
    for (std::uint32_t n = 0; n < graph.nodes.size(); ++n) {
        const SheetNode& node = graph.nodes[n];
        positions.push_back(node.position);
        normals.push_back(found.turned[n] ? Vec3f(-node.normal) : node.normal);
    }
    return findInwardParts({positions, normals, found.parts}, progress);
}

/// What each node would have to be turned: in each part the fewer points, or, where both are many,
/// those that then look inward.
std::vector<char> solve(const SheetGraph& graph, Interrupter& progress)
{
    constexpr std::uint64_t kClearly = 2; // to one; [tuned: clean_points_test]
    const Orientation found = solveOrientation(graph.nodes.size(), graph.links, progress);
    struct Part {
        std::uint64_t points = 0, turned = 0;
    };
    std::vector<Part> parts(graph.nodes.size());
    for (std::uint32_t n = 0; n < graph.nodes.size(); ++n) {
        Part& part = parts[found.parts[n]];
        part.points += graph.nodes[n].points;
        if (found.turned[n]) part.turned += graph.nodes[n].points;
    }
    const std::vector<char> inward = inwardParts(graph, found, progress);
    std::vector<char> turn(graph.nodes.size(), 0);
    for (std::uint32_t n = 0; n < graph.nodes.size(); ++n) {
        const Part& part = parts[found.parts[n]];
        const std::uint64_t kept = part.points - part.turned;
        bool others = inward[found.parts[n]];
        if (kept > kClearly * part.turned) others = false;
        if (part.turned > kClearly * kept) others = true;
        turn[n] = bool(found.turned[n]) != others;
    }
    return turn;
}

/// What is said across the border of nodes to turn together, as they are.
struct Border {
    double pairs = 0;   ///< of points
    double against = 0; ///< pairs that say they look the wrong way, less those that say the right

    /// Where a thin part's rim or noise was taken for a border, hardly any of the pairs say so.
    bool isOfFlipped() const
    {
        // The share of the pairs. [tuned: clean_points_test; at 0.1 real scans lose twice as many
        // normals, and patches on noisy thin parts are found more often]
        constexpr double kAgainst = 0.35;
        return against > kAgainst * pairs;
    }
};

/// Keep only those groups of nodes to turn that are flipped beyond doubt.
void confirm(const SheetGraph& graph, std::vector<char>& turn)
{
    UnionFind sets(graph.nodes.size());
    for (const OrientationLink& l : graph.links)
        if (turn[l.a] && turn[l.b] && l.vote != 0) sets.join(l.a, l.b);
    std::vector<Border> borders(graph.nodes.size());
    for (const OrientationLink& l : graph.links) {
        if (turn[l.a] == turn[l.b]) continue;
        Border& border = borders[sets.find(turn[l.a] ? l.a : l.b)];
        const double pairs = graph.pairsOf(l);
        border.pairs += pairs;
        if (l.vote != 0) border.against += l.vote < 0 ? pairs : -pairs;
    }
    for (std::uint32_t n = 0; n < turn.size(); ++n)
        turn[n] = turn[n] && borders[sets.find(n)].isOfFlipped();
}

} // namespace

void turnFlippedPatches(const PointCells& cells, double noise, bool many, TurnedNormals& normals,
                        Interrupter& progress)
{
    const SheetCells sheets(cells, float(noise), normals);
    std::vector<char> alike(cells.cells().size());
    forEachParallel(alike.size(), kPatchGrain, progress,
                    [&](std::size_t c) { alike[c] = sheets.isAlike(cells.cells()[c]) ? 1 : 0; });
    if (!many && !anyBorder(sheets, alike, progress)) return;
    const SheetGraph graph = SheetGrapher(sheets, alike, progress).graph();
    std::vector<char> turn = solve(graph, progress);
    confirm(graph, turn);
    for (std::uint32_t n = 0; n < graph.nodeOf.size(); ++n)
        if (turn[graph.nodeOf[n]]) normals.turn(cells.index().order()[n]);
}

} // namespace mpuvdb
