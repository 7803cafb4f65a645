#include "point_winding.h"

#include "core/morton.h"
#include "core/parallel_each.h"
#include <mpuvdb/interrupter.h>

#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace mpuvdb
{
namespace
{

constexpr std::size_t kDipoleGrain = 256; // dipoles; [free: the same numbers]

/// The side of an axis to which a normal looks most, of six.
int sideOf(const Vec3f& normal)
{
    int axis = 0;
    normal.cwiseAbs().maxCoeff(&axis);
    return 2 * axis + int(normal[axis] > 0);
}

} // namespace

PointWinding::PointWinding(const std::vector<Part>& parts, const OrientedParts& points,
                           const std::vector<float>& areas, float noise)
{
    for (const Part& part : parts) gather(part, points, areas, noise);
    build(0, std::uint32_t(mDipoles.size()));
}

float PointWinding::at(const Vec3f& p) const
{
    return sumAt(0, p) / float(4 * M_PI);
}

std::vector<float> PointWinding::onPoints(Interrupter& progress) const
{
    std::vector<float> ofDipole(mDipoles.size());
    forEachParallel(ofDipole.size(), kDipoleGrain, progress, [&](std::size_t d) {
        constexpr float kPlane = 3; // points; [derived: fewer have no side]
        if (mDipoles[d].points >= kPlane) ofDipole[d] = at(mDipoles[d].position);
    });
    std::vector<float> numbers(mDipoleOf.size());
    for (std::size_t k = 0; k < numbers.size(); ++k) numbers[k] = ofDipole[mDipoleOf[k]];
    return numbers;
}

float PointWinding::Dipole::at(const Vec3f& p) const
{
    const Vec3f apart = position - p;
    const float squared = apart.squaredNorm() + softening;
    return apart.dot(areaNormal) / (squared * std::sqrt(squared));
}

void PointWinding::gather(const Part& part, const OrientedParts& points,
                          const std::vector<float>& areas, float noise)
{
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
    const std::size_t first = mDipoleOf.size();
    mDipoleOf.resize(first + keys.size());
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
            mDipoleOf[first + k] = std::uint32_t(mDipoles.size());
        }
        dipole.points = float(end - begin);
        dipole.position /= dipole.points;
        dipole.areaNormal *= std::min(most / area, 1.f);
        dipole.softening = std::min(most, area) / float(2 * M_PI);
        mDipoles.push_back(dipole);
    }
}

std::uint32_t PointWinding::build(std::uint32_t begin, std::uint32_t end)
{
    constexpr std::uint32_t kLeaf = 8; // dipoles; [free: the same numbers but for rounding]
    const auto at = std::uint32_t(mNodes.size());
    mNodes.emplace_back();
    Node node;
    node.begin = begin;
    node.end = end;
    float weight = 0;
    for (std::uint32_t d = begin; d < end; ++d) {
        const Dipole& dipole = mDipoles[d];
        const float of = std::max(dipole.areaNormal.norm(), std::numeric_limits<float>::min());
        node.sum.position += of * dipole.position;
        node.sum.areaNormal += dipole.areaNormal;
        node.sum.softening = std::max(node.sum.softening, dipole.softening);
        weight += of;
    }
    node.sum.position /= weight;
    for (std::uint32_t d = begin; d < end; ++d)
        node.radius2 =
            std::max(node.radius2, (mDipoles[d].position - node.sum.position).squaredNorm());
    if (end - begin > kLeaf) {
        build(begin, (begin + end) / 2);
        node.second = build((begin + end) / 2, end);
    }
    mNodes[at] = node;
    return at;
}

float PointWinding::sumAt(std::uint32_t n, const Vec3f& p) const
{
    // Distance, in radii, from which a node is a single dipole. [paper: Barill18]
    constexpr float kFar = 2;
    const Node& node = mNodes[n];
    if ((node.sum.position - p).squaredNorm() > kFar * kFar * node.radius2) return node.sum.at(p);
    if (node.second != 0) return sumAt(n + 1, p) + sumAt(node.second, p);
    float sum = 0;
    for (std::uint32_t d = node.begin; d < node.end; ++d) sum += mDipoles[d].at(p);
    return sum;
}

} // namespace mpuvdb
