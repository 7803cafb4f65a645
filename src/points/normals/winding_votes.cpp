#include "winding_votes.h"

#include "core/morton.h"
#include "core/parallel_each.h"
#include <mpuvdb/interrupter.h>

#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>

namespace mpuvdb
{
namespace
{

constexpr std::size_t kGrain = 256; // dipoles; [free: the same numbers]
constexpr int kSides = 6;           // [derived: of three axes]

/// One side of the surface in a cell of a grid.
struct Dipole {
    Vec3f position = Vec3f::Zero();
    Vec3f areaNormal = Vec3f::Zero(); ///< world units squared
    float softening = 0;              ///< world units squared: of a disc, not of a point
    float points = 0;                 ///< their number
};

/// The side of an axis to which a normal looks most.
int sideOf(const Vec3f& normal)
{
    int axis = 0;
    normal.cwiseAbs().maxCoeff(&axis);
    return 2 * axis + int(normal[axis] > 0);
}

/// Dipoles in order of space, and of each point its dipole.
struct Dipoles {
    std::vector<Dipole> all;
    std::vector<std::uint32_t> of; ///< of the part's points
};

Dipoles dipolesOf(const Part& part, const OrientedParts& points, const std::vector<float>& areas,
                  float noise)
{
    // Points for a square of the box. [derived: a cell of a ball has ten then, so that none is
    // missed]
    constexpr double kPointsPerCell = 32;
    // Along the longest side. [derived: two bits fewer than mortonKey() takes, for the sides]
    constexpr double kMostCells = 1 << 19;
    const double cells =
        std::clamp(std::sqrt(double(part.points.size()) / kPointsPerCell), 1.0, kMostCells);
    // A cell holds the whole layer that noise makes of a surface. [derived: two standard
    // deviations to both sides]
    constexpr float kLayer = 4;
    const float cell = std::max({part.box.sizes().maxCoeff() / float(cells), kLayer * noise,
                                 std::numeric_limits<float>::min()});
    std::vector<std::pair<std::uint64_t, std::uint32_t>> keys(part.points.size());
    for (std::uint32_t k = 0; k < keys.size(); ++k) {
        const std::uint32_t i = part.points[k];
        const Vec3f in = (points.positions[i] - part.box.min()) / cell;
        const std::uint64_t code =
            mortonKey(std::uint64_t(in.x()), std::uint64_t(in.y()), std::uint64_t(in.z()));
        keys[k] = {code * 8 + std::uint64_t(sideOf(points.normals[i])), k};
    }
    tbb::parallel_sort(keys.begin(), keys.end());
    Dipoles dipoles;
    dipoles.of.resize(keys.size());
    // The largest area of a plane in a cell, world units squared: that of a diagonal rectangle.
    const auto most = float(M_SQRT2) * cell * cell;
    for (std::size_t begin = 0, end = 0; begin < keys.size(); begin = end) {
        Dipole dipole;
        float area = 0;
        for (end = begin; end < keys.size() && keys[end].first == keys[begin].first; ++end) {
            const std::uint32_t k = keys[end].second, i = part.points[k];
            dipole.position += points.positions[i];
            dipole.areaNormal += areas[i] * points.normals[i];
            area += areas[i];
            dipoles.of[k] = std::uint32_t(dipoles.all.size());
        }
        dipole.points = float(end - begin);
        dipole.position /= dipole.points;
        dipole.areaNormal *= std::min(most / area, 1.f);
        dipole.softening = std::min(most, area) / float(2 * M_PI);
        dipoles.all.push_back(dipole);
    }
    return dipoles;
}

/// Sums of dipoles, halved again and again in order of space.
class DipoleTree
{
public:
    explicit DipoleTree(const Dipoles& dipoles) : mDipoles(dipoles)
    {
        mNodes.reserve(2 * dipoles.all.size() / kLeaf + 1);
        build(0, std::uint32_t(dipoles.all.size()));
    }

    float numberAt(const Vec3f& p) const { return sumAt(0, p) / float(4 * M_PI); }

private:
    static constexpr std::uint32_t kLeaf = 8; // dipoles; [free: the same numbers but for rounding]
    /// Distance, in radii, from which a node is a single dipole. [paper: Barill18]
    static constexpr float kFar = 2;

    struct Node {
        Dipole sum;
        float radius2 = 0; ///< world units squared
        std::uint32_t begin = 0, end = 0;
        std::uint32_t second = 0; ///< child; the first one follows the node; 0: a leaf
    };

    std::uint32_t build(std::uint32_t begin, std::uint32_t end)
    {
        const auto at = std::uint32_t(mNodes.size());
        mNodes.emplace_back();
        Node node;
        node.begin = begin;
        node.end = end;
        float weight = 0;
        for (std::uint32_t d = begin; d < end; ++d) {
            const Dipole& dipole = mDipoles.all[d];
            const float of = std::max(dipole.areaNormal.norm(), std::numeric_limits<float>::min());
            node.sum.position += of * dipole.position;
            node.sum.areaNormal += dipole.areaNormal;
            node.sum.softening = std::max(node.sum.softening, dipole.softening);
            weight += of;
        }
        node.sum.position /= weight;
        for (std::uint32_t d = begin; d < end; ++d)
            node.radius2 = std::max(node.radius2,
                                    (mDipoles.all[d].position - node.sum.position).squaredNorm());
        if (end - begin > kLeaf) {
            build(begin, (begin + end) / 2);
            node.second = build((begin + end) / 2, end);
        }
        mNodes[at] = node;
        return at;
    }

    float of(const Dipole& dipole, const Vec3f& p) const
    {
        const Vec3f apart = dipole.position - p;
        const float squared = apart.squaredNorm() + dipole.softening;
        return apart.dot(dipole.areaNormal) / (squared * std::sqrt(squared));
    }

    float sumAt(std::uint32_t n, const Vec3f& p) const
    {
        const Node& node = mNodes[n];
        if ((node.sum.position - p).squaredNorm() > kFar * kFar * node.radius2)
            return of(node.sum, p);
        if (node.second != 0) return sumAt(n + 1, p) + sumAt(node.second, p);
        float sum = 0;
        for (std::uint32_t d = node.begin; d < node.end; ++d) sum += of(mDipoles.all[d], p);
        return sum;
    }

    const Dipoles& mDipoles;
    std::vector<Node> mNodes;
};

/// The winding number at each of the part's points, between its two sides; 0 where hardly any
/// points are. @param areas, noise  as those of windingVotes().
std::vector<float> numbersOn(const Part& part, const OrientedParts& points,
                             const std::vector<float>& areas, float noise, Interrupter& progress)
{
    const Dipoles dipoles = dipolesOf(part, points, areas, noise);
    const DipoleTree tree(dipoles);
    std::vector<float> ofDipole(dipoles.all.size());
    forEachParallel(ofDipole.size(), kGrain, progress, [&](std::size_t d) {
        constexpr float kPlane = 3; // points; [derived: fewer have no side]
        const Dipole& dipole = dipoles.all[d];
        if (dipole.points >= kPlane) ofDipole[d] = tree.numberAt(dipole.position);
    });
    std::vector<float> numbers(dipoles.of.size());
    for (std::size_t k = 0; k < numbers.size(); ++k) numbers[k] = ofDipole[dipoles.of[k]];
    return numbers;
}

} // namespace

WindingVotes windingVotes(const OrientedParts& points, const std::vector<float>& areas,
                          double noise, Interrupter& progress)
{
    // Distances of the number from a half. [derived: a quarter from 0, which is right, and from 1,
    // which is wrong]
    constexpr float kRight = 0.25f, kWrong = 0.75f;
    const std::size_t firstPart = points.positions.size() + 1; // after the scanners
    WindingVotes votes;
    votes.nodes = firstPart + partEnd(points);
    for (const Part& part : collectParts(points)) {
        progress.check();
        const std::vector<float> numbers = numbersOn(part, points, areas, float(noise), progress);
        const bool inward = std::accumulate(numbers.begin(), numbers.end(), 0.0) < 0;
        const std::uint32_t name = points.parts[part.points.front()];
        for (std::size_t k = 0; k < numbers.size(); ++k) {
            const float off = std::abs((inward ? -numbers[k] : numbers[k]) - 0.5f);
            if (off > kRight && off < kWrong) continue;
            OrientationLink link;
            link.vote = off < kWrong ? 1 : -1;
            link.a = part.points[k];
            link.b = std::uint32_t(firstPart) + name;
            votes.links.push_back(link);
            votes.against += link.vote < 0 ? 1 : 0;
        }
    }
    return votes;
}

} // namespace mpuvdb
