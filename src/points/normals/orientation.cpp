#include "orientation.h"

#include <mpuvdb/interrupter.h>

#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>
#include <utility>

namespace mpuvdb
{
namespace
{

constexpr std::size_t kCheckEvery = 65536; // links; [free: the same orientation]
/// Bounds of the votes of links that join two nodes alone. [tuned: estimate_normals_test]
constexpr float kClasses[] = {2, 0.99f, 0.97f, 0.94f, 0.9f};
/// The weight of a link across sheets. [tuned: estimate_normals_test]
constexpr float kAcrossSheets = 0.25f;

/// Trees of nodes that share an orientation; each knows whether it is turned against its parent.
class Forest
{
public:
    explicit Forest(std::size_t count) : mParents(count), mTurned(count, 0)
    {
        std::iota(mParents.begin(), mParents.end(), 0u);
    }

    /// Root of @a i's tree, and whether i is turned against it. Shortens the path.
    std::pair<std::uint32_t, bool> find(std::uint32_t i)
    {
        std::uint32_t root = i;
        bool turned = false;
        while (mParents[root] != root) {
            turned ^= bool(mTurned[root]);
            root = mParents[root];
        }
        bool rest = turned;
        while (mParents[i] != root && i != root) {
            const std::uint32_t next = mParents[i];
            const bool nextRest = rest ^ bool(mTurned[i]);
            mParents[i] = root;
            mTurned[i] = rest;
            i = next;
            rest = nextRest;
        }
        return {root, turned};
    }

    /// Join two trees, if they are two; @a turned says how a stands to b. The lower root stays.
    void join(std::uint32_t a, std::uint32_t b, bool turned)
    {
        auto [rootA, turnedA] = find(a);
        auto [rootB, turnedB] = find(b);
        if (rootA == rootB) return;
        if (rootB < rootA) std::swap(rootA, rootB);
        mParents[rootB] = rootA;
        mTurned[rootB] = turned ^ turnedA ^ turnedB;
    }

private:
    std::vector<std::uint32_t> mParents;
    std::vector<char> mTurned;
};

/// Join nodes by sure links one by one, the surest first: in classes, which is as good as sorted.
void joinSure(const std::vector<OrientationLink>& links, Forest& forest, Interrupter& progress)
{
    for (std::size_t c = 1; c < std::size(kClasses); ++c)
        for (std::size_t k = 0; k < links.size(); ++k) {
            if (k % kCheckEvery == 0) progress.check();
            const OrientationLink& l = links[k];
            const float vote = std::abs(l.vote);
            if (!l.unsure && vote >= kClasses[c] && vote < kClasses[c - 1])
                forest.join(l.a, l.b, l.vote < 0);
        }
}

/// All that is said between two trees, by their roots; a < b.
struct PatchLink {
    std::uint32_t a, b;
    double vote;
};

bool betweenBefore(const PatchLink& x, const PatchLink& y)
{
    if (x.a != y.a) return x.a < y.a;
    return x.b != y.b ? x.b < y.b : x.vote < y.vote;
}

/// Links as they stand between the trees' roots, one for each pair; what is within a tree is left
/// out.
void gather(std::vector<PatchLink>& links, Forest& forest, Interrupter& progress)
{
    std::size_t kept = 0;
    for (std::size_t k = 0; k < links.size(); ++k) {
        if (k % kCheckEvery == 0) progress.check();
        const auto [a, turnedA] = forest.find(links[k].a);
        const auto [b, turnedB] = forest.find(links[k].b);
        if (a == b) continue;
        const double vote = turnedA != turnedB ? -links[k].vote : links[k].vote;
        links[kept++] = {std::min(a, b), std::max(a, b), vote};
    }
    links.resize(kept);
    tbb::parallel_sort(links.begin(), links.end(), betweenBefore);
    kept = 0;
    for (std::size_t k = 0; k < links.size(); ++k) {
        if (kept > 0 && links[kept - 1].a == links[k].a && links[kept - 1].b == links[k].b)
            links[kept - 1].vote += links[k].vote;
        else
            links[kept++] = links[k];
    }
    links.resize(kept);
}

/// Trees of more than one node, joined by what all their nodes say.
class PatchJoiner
{
public:
    PatchJoiner(std::size_t nodes, Forest& forest, Interrupter& progress)
        : mForest(forest), mProgress(progress), mSizes(nodes, 0), mBest(nodes)
    {
        for (std::uint32_t i = 0; i < nodes; ++i) ++mSizes[forest.find(i).first];
    }

    /// Join every tree with the one that it has most to do with, until none is left that has enough
    /// to do with another.
    void run(std::vector<PatchLink>& links)
    {
        do gather(links, mForest, mProgress);
        while (joinOnce(links));
    }

private:
    /// Two large patches are not joined by a few links, which can be wrong: theirs is a border of
    /// some sqrt(n) nodes.
    bool isFirm(const PatchLink& l) const
    {
        // Nodes, and votes for each node of the border. [tuned: estimate_normals_test]
        constexpr std::uint32_t kLarge = 100;
        constexpr double kFirm = 0.25;
        const std::uint32_t smaller = std::min(mSizes[l.a], mSizes[l.b]);
        return smaller < kLarge || std::abs(l.vote) >= kFirm * std::sqrt(double(smaller));
    }

    bool joinOnce(const std::vector<PatchLink>& links)
    {
        // The order, and with it the sums, depend on the nodes' numbers only.
        const auto stronger = [&](std::size_t x, std::size_t y) {
            const double vx = std::abs(links[x].vote), vy = std::abs(links[y].vote);
            return vx != vy ? vx > vy : x < y;
        };
        for (const PatchLink& l : links) mBest[l.a] = mBest[l.b] = ~0u;
        for (std::uint32_t k = 0; k < links.size(); ++k) {
            if (!isFirm(links[k])) continue;
            for (const std::uint32_t end : {links[k].a, links[k].b})
                if (mBest[end] == ~0u || stronger(k, mBest[end])) mBest[end] = k;
        }
        std::vector<std::uint32_t> chosen;
        for (std::uint32_t k = 0; k < links.size(); ++k)
            if (mBest[links[k].a] == k || mBest[links[k].b] == k) chosen.push_back(k);
        std::sort(chosen.begin(), chosen.end(), stronger);
        for (const std::uint32_t k : chosen) join(links[k]);
        return !chosen.empty();
    }

    void join(const PatchLink& l)
    {
        const std::uint32_t a = mForest.find(l.a).first, b = mForest.find(l.b).first;
        if (a == b) return;
        mForest.join(l.a, l.b, l.vote < 0);
        mSizes[std::min(a, b)] = mSizes[a] + mSizes[b];
    }

    Forest& mForest;
    Interrupter& mProgress;
    std::vector<std::uint32_t> mSizes; ///< of trees, by root
    std::vector<std::uint32_t> mBest;  ///< of each tree its strongest link
};

} // namespace

OrientationLink orientationLink(std::uint32_t a, std::uint32_t b, const Vec3f& apart,
                                const Vec3f& normalA, const Vec3f& normalB, float noise)
{
    // The cosine of parallel planes; others may be edges, or no planes. [tuned:
    // estimate_normals_test]
    constexpr float kParallel = 0.97f;
    OrientationLink link;
    link.a = std::min(a, b);
    link.b = std::max(a, b);
    link.vote = normalA.dot(normalB);
    const float length = apart.norm();
    if (!(length > 0)) return link;
    const auto slope = [&](const Vec3f& normal, float unsure) {
        const float height = normal.dot(apart);
        return std::copysign(std::max(std::abs(height) - unsure, 0.f), height) / length;
    };
    const auto mirroredBy = [&](float unsure) {
        return link.vote - 2 * slope(normalA, unsure) * slope(normalB, unsure);
    };
    // Heights that noise can make say nothing; nor does an edge whose faces turn away by more than
    // a right angle, if without its heights it would say the opposite.
    const float mirrored = mirroredBy(2 * noise);
    if (mirrored * mirroredBy(0) < 0) {
        link.vote = 0;
        return link;
    }
    const bool across = mirrored * link.vote < 0 && std::abs(link.vote) > std::abs(mirrored) / 4;
    link.unsure = across || std::abs(link.vote) < kParallel;
    link.vote = across ? kAcrossSheets * mirrored : mirrored;
    return link;
}

OrientationLink linkAcrossSheets(std::uint32_t a, std::uint32_t b, const Vec3f& normalA,
                                 const Vec3f& normalB)
{
    return {std::copysign(kAcrossSheets, -normalA.dot(normalB)), true, std::min(a, b),
            std::max(a, b)};
}

Orientation solveOrientation(std::size_t nodes, const std::vector<OrientationLink>& links,
                             Interrupter& progress, const std::vector<OrientationLink>& known)
{
    Forest forest(nodes);
    for (const OrientationLink& l : known) forest.join(l.a, l.b, l.vote < 0);
    joinSure(links, forest, progress);
    std::vector<PatchLink> between;
    for (const OrientationLink& l : links)
        if (forest.find(l.a).first != forest.find(l.b).first) between.push_back({l.a, l.b, l.vote});
    PatchJoiner(nodes, forest, progress).run(between);
    Orientation result;
    result.parts.resize(nodes);
    result.turned.resize(nodes);
    for (std::uint32_t i = 0; i < nodes; ++i) {
        const auto [root, turned] = forest.find(i);
        result.parts[i] = root;
        result.turned[i] = turned;
    }
    return result;
}

std::vector<std::uint32_t> agreeingPieces(const std::vector<OrientationLink>& links,
                                          const std::vector<char>& turned,
                                          const std::vector<char>& groups, Interrupter& progress)
{
    Forest forest(groups.size());
    std::vector<PatchLink> between;
    for (std::size_t k = 0; k < links.size(); ++k) {
        if (k % kCheckEvery == 0) progress.check();
        const OrientationLink& l = links[k];
        if (l.b >= groups.size() || groups[l.a] != groups[l.b]) continue;
        const float vote = turned[l.a] != turned[l.b] ? -l.vote : l.vote;
        if (!l.unsure && vote >= *std::rbegin(kClasses))
            forest.join(l.a, l.b, false);
        else
            between.push_back({l.a, l.b, vote});
    }
    const auto agrees = [](const PatchLink& l) { return l.vote > 0; };
    for (gather(between, forest, progress); std::any_of(between.begin(), between.end(), agrees);
         gather(between, forest, progress))
        for (const PatchLink& l : between)
            if (agrees(l)) forest.join(l.a, l.b, false);
    std::vector<std::uint32_t> pieces(groups.size());
    for (std::uint32_t i = 0; i < pieces.size(); ++i) pieces[i] = forest.find(i).first;
    return pieces;
}

} // namespace mpuvdb
