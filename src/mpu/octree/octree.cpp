#include "octree.h"

#include <mpuvdb/error.h>

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace mpuvdb
{
namespace
{

QuadricCoefficients coefficients(const Quadric& q)
{
    const auto& A = q.A;
    return {float(q.c),         float(q.b[0]),     float(q.b[1]),  float(q.b[2]),
            float(A(0, 0)),     float(A(1, 1)),    float(A(2, 2)), float(2 * A(0, 1)),
            float(2 * A(1, 2)), float(2 * A(2, 0))};
}

Quadric quadric(const QuadricCoefficients& k)
{
    Quadric q;
    q.c = k[0];
    q.b = Vec3d(k[1], k[2], k[3]);
    q.A << k[4], k[7] * 0.5, k[9] * 0.5, k[7] * 0.5, k[5], k[8] * 0.5, k[9] * 0.5, k[8] * 0.5, k[6];
    return q;
}

/// The piece of @a fit, whose pieces are at @a quadrics, that is in effect at @a y.
Quadric rulingOf(const QuadricCoefficients* quadrics, const StoredFit& fit, const Vec3d& y)
{
    const auto piece = [&](int k) { return quadric(quadrics[k]); };
    return piece(rulingPiece(fit.count, fit.maxBits, [&](int k) { return piece(k).value(y); }));
}

} // namespace

void checkSettings(const PointCloud& cloud, const MpuSettings& s)
{
    cloud.demandWhole();
    if (cloud.empty()) throw InputError("no points to fit: the input is empty");
    if (!cloud.hasNormals())
        throw InputError("the points have no normals: estimate them first (estimateNormals, or "
                         "--normals estimate)");
    const auto require = [](bool ok, const char* what, double value, const char* range) {
        if (!ok) throw UsageError(fmt::format("{} is {}; it must be {}", what, value, range));
    };
    require(s.tolerance > 0 && std::isfinite(s.tolerance), "tolerance", s.tolerance, "above 0");
    require(s.noise >= 0 && std::isfinite(s.noise), "noise", s.noise, "0 or above");
    require(s.voxelSize > 0 && std::isfinite(s.voxelSize), "voxel size", s.voxelSize, "above 0");
    if (s.interpolate)
        require(s.alpha >= 1.05 && s.alpha <= 2, "alpha", s.alpha,
                "in [1.05, 2] for interpolation: the ball about a point has to cover its cell");
    else
        require(s.alpha >= 0.6 && s.alpha <= 2, "alpha", s.alpha, "in [0.6, 2]");
    require(s.minPoints >= 6 && s.minPoints <= 1000, "min points", s.minPoints, "in [6, 1000]");
}

RootCube rootCube(const Box3d& bounds, double voxelSize)
{
    const double side = 1.5 * bounds.sizes().maxCoeff() + 16 * voxelSize;
    return {bounds.center() - Vec3d::Constant(side / 2), side};
}

void OctreeDraft::setLeaf(std::uint32_t node, std::uint32_t fit, double support)
{
    nodes[node] = {fit, float(support)};
    complete &= support >= 1;
}

std::uint32_t OctreeDraft::addFit(const LocalFit& fit, const Vec3d& origin)
{
    StoredFit stored;
    stored.origin = origin.cast<float>();
    stored.firstQuadric = std::uint32_t(quadrics.size());
    stored.count = std::uint8_t(fit.count);
    stored.maxBits = std::uint8_t(fit.maxBits);
    // The origin was rounded: shift the pieces accordingly.
    const Vec3d shift = stored.origin.cast<double>() - origin;
    for (int k = 0; k < fit.count; ++k)
        quadrics.push_back(coefficients(fit.pieces[std::size_t(k)].shifted(shift)));
    fits.push_back(stored);
    ++statistics.fits;
    statistics.sharpFits += fit.isSharp();
    return std::uint32_t(fits.size() - 1);
}

std::uint32_t OctreeDraft::addFitThrough(const Vec3f& point, const Quadric& fit)
{
    LocalFit single;
    single.pieces[0] = fit;
    const std::uint32_t index = addFit(single, point.cast<double>());
    fits[index].throughOrigin = true;
    return index;
}

Quadric OctreeDraft::rulingAt(const StoredFit& fit, const Vec3d& y) const
{
    return rulingOf(quadrics.data() + fit.firstQuadric, fit, y);
}

Octree::Octree(OctreeDraft&& draft)
    : OctreeShape(draft), nodes(std::move(draft.nodes)), fits(std::move(draft.fits)),
      quadrics(std::move(draft.quadrics)), statistics(draft.statistics)
{
}

Quadric Octree::rulingAt(const StoredFit& fit, const Vec3d& y) const
{
    return rulingOf(quadrics.data() + fit.firstQuadric, fit, y);
}

Quadric Octree::pieceAbout(const StoredFit& fit, std::size_t piece, const Vec3d& origin) const
{
    return quadric(quadrics[fit.firstQuadric + piece]).shifted(origin - fit.origin.cast<double>());
}

void OctreeDraft::graft(std::uint32_t at, const OctreeDraft& subtree)
{
    const auto nodeShift = std::uint32_t(nodes.size()) - 1; // its node 0 goes elsewhere
    const auto fitShift = std::uint32_t(fits.size());
    const auto quadricShift = std::uint32_t(quadrics.size());
    const auto moved = [&](OctreeNode node) {
        node.index += node.isLeaf() ? fitShift : nodeShift;
        return node;
    };
    nodes[at] = moved(subtree.nodes[0]);
    for (std::size_t n = 1; n < subtree.nodes.size(); ++n) nodes.push_back(moved(subtree.nodes[n]));
    for (StoredFit fit : subtree.fits) {
        fit.firstQuadric += quadricShift;
        fits.push_back(fit);
    }
    quadrics.insert(quadrics.end(), subtree.quadrics.begin(), subtree.quadrics.end());

    complete &= subtree.complete;
    add(subtree.statistics);
}

void OctreeDraft::add(const MpuStatistics& s)
{
    statistics.cells += s.cells;
    statistics.leaves += s.leaves;
    statistics.fits += s.fits;
    statistics.sharpFits += s.sharpFits;
    statistics.levels = std::max(statistics.levels, s.levels);
    statistics.maxError = std::max(statistics.maxError, s.maxError);
    statistics.overTolerance += s.overTolerance;
}

std::uint64_t OctreeDraft::usedBytes() const
{
    return nodes.size() * sizeof(OctreeNode) + fits.size() * sizeof(StoredFit) +
           quadrics.size() * sizeof(QuadricCoefficients);
}

std::uint64_t Octree::bytes() const
{
    return nodes.bytes() + fits.bytes() + quadrics.bytes();
}

} // namespace mpuvdb
