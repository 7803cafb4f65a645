// Normals of bare points: least-squares planes, then one orientation for all of a part.
#include "kd_tree.h"
#include "position_order.h"

#include <mpuvdb/error.h>
#include <mpuvdb/normals.h>
#include <mpuvdb/progress.h>

#include <Eigen/Eigenvalues>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <numeric>

namespace mpuvdb
{
namespace
{

constexpr std::size_t kGrain = 1024; // points

/// Normal of the plane through the middle of some positions that leaves the least squares.
Vec3f planeNormal(const std::vector<Vec3f>& positions, const std::vector<std::uint32_t>& members)
{
    const Vec3d base = positions[members.front()].cast<double>();
    Vec3d mean = Vec3d::Zero();
    for (const std::uint32_t m : members) mean += positions[m].cast<double>() - base;
    mean /= double(members.size());
    Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
    for (const std::uint32_t m : members) {
        const Vec3d d = positions[m].cast<double>() - base - mean;
        scatter += d * d.transpose();
    }
    // Scaled, because the direct solver works to absolute precision.
    const double size = scatter.trace();
    if (!(size > 0)) return Vec3f::UnitZ();
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes;
    axes.computeDirect(scatter / size);
    return axes.eigenvectors().col(0).normalized().cast<float>();
}

/// Two neighbours and how badly their planes agree.
struct Link {
    float weight;
    std::uint32_t a, b;

    friend bool operator<(const Link& x, const Link& y)
    {
        if (x.weight != y.weight) return x.weight < y.weight;
        return x.a != y.a ? x.a < y.a : x.b < y.b;
    }
};

/// Cosine between the planes' normals as seen along the line from one point to the other: 1 on a
/// plane or an arc, still 1/2 across a right-angled edge, 0 for the two sides of a thin wall. Its
/// sign says whether the normals look to the same side.
float agreement(const Vec3f& normalA, const Vec3f& normalB, const Vec3f& apart)
{
    const float length = apart.norm();
    if (!(length > 0)) return normalA.dot(normalB);
    const Vec3f d = apart / length;
    return normalA.dot(normalB) - normalA.dot(d) * normalB.dot(d);
}

/// Planes and links of distinct positions.
struct PlaneGraph {
    std::vector<Vec3f> normals;
    std::vector<Link> links;
};

PlaneGraph fitPlanes(const std::vector<Vec3f>& positions, std::size_t neighbors, Progress& progress)
{
    constexpr std::size_t kLinks = 10; // nearest neighbours that are linked
    const std::size_t count = positions.size();
    const std::size_t links = std::min({kLinks, neighbors, count - 1});
    PlaneGraph graph;
    graph.normals.resize(count);
    std::vector<std::uint32_t> linked(count * links);
    const KdTree tree(positions);
    progress.check();
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, kGrain), [&](const auto& range) {
        progress.advance(double(range.size()) / double(count));
        std::vector<std::uint32_t> indices;
        std::vector<float> squared;
        for (std::size_t i = range.begin(); i < range.end(); ++i) {
            indices.resize(neighbors + 1);
            squared.resize(neighbors + 1);
            tree.nearest(positions[i], indices, squared);
            graph.normals[i] = planeNormal(positions, indices);
            // The point is its own nearest; distinct positions can round to the same distance.
            const auto self = std::find(indices.begin(), indices.end(), std::uint32_t(i));
            if (self != indices.end()) indices.erase(self);
            std::copy_n(indices.begin(), links, linked.begin() + std::ptrdiff_t(i * links));
        }
    });
    graph.links.resize(linked.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, kGrain), [&](const auto& range) {
        progress.check();
        for (std::size_t k = range.begin() * links; k < range.end() * links; ++k) {
            const auto [a, b] = std::minmax({std::uint32_t(k / links), linked[k]});
            const float c =
                agreement(graph.normals[a], graph.normals[b], positions[b] - positions[a]);
            graph.links[k] = {1 - std::abs(c), a, b};
        }
    });
    return graph;
}

/// Trees of points that share an orientation; each point knows whether it is turned against its
/// parent.
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

/// Whether a part's normals look inward, told by its outermost points: those farthest out along
/// each axis, both ways, whose normals weigh as much as they keep to the axis.
class OutwardVote
{
public:
    void add(const Vec3f& position, const Vec3f& normal)
    {
        for (int axis = 0; axis < 3; ++axis) {
            if (position[axis] < mLow[axis]) {
                mLow[axis] = position[axis];
                mLowNormal[axis] = -normal[axis];
            }
            if (position[axis] > mHigh[axis]) {
                mHigh[axis] = position[axis];
                mHighNormal[axis] = normal[axis];
            }
        }
    }
    bool inward() const { return mLowNormal.sum() + mHighNormal.sum() < 0; }

private:
    Vec3f mLow = Vec3f::Constant(HUGE_VALF), mHigh = Vec3f::Constant(-HUGE_VALF);
    Vec3f mLowNormal = Vec3f::Zero(), mHighNormal = Vec3f::Zero();
};

/// Turn the normals of each tree of the minimum spanning forest to one side, outward.
void orient(const std::vector<Vec3f>& positions, PlaneGraph& graph, Progress& progress)
{
    tbb::parallel_sort(graph.links.begin(), graph.links.end());
    Forest forest(positions.size());
    for (std::size_t k = 0; k < graph.links.size(); ++k) {
        if (k % 65536 == 0) progress.check();
        const Link& l = graph.links[k];
        const bool turned =
            agreement(graph.normals[l.a], graph.normals[l.b], positions[l.b] - positions[l.a]) < 0;
        forest.join(l.a, l.b, turned);
    }
    std::vector<std::uint32_t> roots(positions.size());
    std::vector<std::uint32_t> parts(positions.size(), ~0u); // of roots
    std::vector<OutwardVote> votes;
    for (std::uint32_t i = 0; i < positions.size(); ++i) {
        if (i % 65536 == 0) progress.check();
        const auto [root, turned] = forest.find(i);
        if (turned) graph.normals[i] = -graph.normals[i];
        if (parts[root] == ~0u) {
            parts[root] = std::uint32_t(votes.size());
            votes.emplace_back();
        }
        roots[i] = root;
        votes[parts[root]].add(positions[i], graph.normals[i]);
    }
    for (std::size_t i = 0; i < positions.size(); ++i)
        if (votes[parts[roots[i]]].inward()) graph.normals[i] = -graph.normals[i];
}

} // namespace

void estimateNormals(PointCloud& cloud, int neighbours, Progress& progress)
{
    constexpr int kFewest = 4, kMost = 1000;
    if (neighbours < kFewest || neighbours > kMost)
        throw UsageError(fmt::format("normals from {} neighbours: out of range. Give {} to {}",
                                     neighbours, kFewest, kMost));
    // In the order of the positions, and one of each: the result depends on no other order.
    std::vector<Vec3f> distinct = cloud.positions;
    tbb::parallel_sort(distinct.begin(), distinct.end(), positionBefore);
    distinct.erase(std::unique(distinct.begin(), distinct.end()), distinct.end());
    if (distinct.size() < kFewest)
        throw InputError(fmt::format("normals need at least {} distinct points, there are {}. Give "
                                     "more points, or points with normals",
                                     kFewest, distinct.size()));
    PlaneGraph graph = fitPlanes(distinct, std::size_t(neighbours), progress);
    orient(distinct, graph, progress);
    cloud.normals.resize(cloud.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, cloud.size(), kGrain),
                      [&](const auto& range) {
                          progress.check();
                          for (std::size_t i = range.begin(); i < range.end(); ++i) {
                              const auto at = std::lower_bound(distinct.begin(), distinct.end(),
                                                               cloud.positions[i], positionBefore);
                              cloud.normals[i] = graph.normals[std::size_t(at - distinct.begin())];
                          }
                      });
}

} // namespace mpuvdb
