// The faces of an edge or a corner, separated by normals [Ohtake03 §4c].
#pragma once
#include "cell_points.h"
#include "quadric.h"

#include <limits>
#include <utility>
#include <vector>

namespace mpuvdb
{

/// Least cosine of a normal across two faces that is of a third one. [paper: Ohtake03 eq. 15]
constexpr double kCornerCosine = 0.7;

/// Indices of points with similar normals.
using NormalClusters = std::vector<std::vector<std::uint32_t>>;

/// Spherical Voronoi cells of the members' normals about the axes; empty ones left out.
NormalClusters clusterNormals(const CellPoints& points, const std::vector<std::uint32_t>& members,
                              const std::vector<Vec3d>& axes);

/// Combine the faces in the way of least errorOf(LocalFit): convex, concave, or one face apart
/// [Ohtake03 §4c].
template <typename ErrorOf>
void combineFaces(LocalFit& fit, const ErrorOf& errorOf)
{
    const LocalFit faces = fit;
    double best = std::numeric_limits<double>::infinity();
    const auto attempt = [&](int alone, unsigned maxBits) {
        LocalFit candidate = faces;
        std::swap(candidate.pieces[0], candidate.pieces[std::size_t(alone)]);
        candidate.maxBits = maxBits;
        const double error = errorOf(candidate);
        if (error < best) {
            best = error;
            fit = candidate;
        }
    };
    attempt(0, ~0u);
    attempt(0, 0u);
    for (int alone = 0; fit.count == 3 && alone < 3; ++alone) {
        attempt(alone, 1u); // max(p0, min(p1, p2))
        attempt(alone, 2u); // min(p0, max(p1, p2))
    }
}

} // namespace mpuvdb
