// Normals of meshes, and the question whether normals look inward.
#include <mpuvdb/normals.h>

#include <algorithm>
#include <cmath>

namespace mpuvdb
{

std::vector<Vec3f> vertexNormals(const std::vector<Vec3f>& positions,
                                 const std::vector<std::array<std::uint32_t, 3>>& triangles)
{
    std::vector<Vec3d> sums(positions.size(), Vec3d::Zero());
    for (const auto& t : triangles) {
        const Vec3d a = positions[t[0]].cast<double>();
        const Vec3d b = positions[t[1]].cast<double>() - a;
        const Vec3d c = positions[t[2]].cast<double>() - a;
        const Vec3d twiceArea = b.cross(c);
        for (const std::uint32_t v : t) sums[v] += twiceArea;
    }
    std::vector<Vec3f> normals(positions.size());
    for (std::size_t i = 0; i < normals.size(); ++i) {
        const double length = sums[i].norm();
        normals[i] = length > 0 ? Vec3f((sums[i] / length).cast<float>()) : Vec3f(Vec3f::Zero());
    }
    return normals;
}

namespace
{

/// Sums over the points of one cell of a coarse grid.
struct CellSum {
    double count = 0;
    double flux = 0; ///< of position . normal
    Vec3d position = Vec3d::Zero();
    Vec3d normal = Vec3d::Zero();
};

/// A surface covers about the same area in every cell of a grid that it meets. A mean per cell
/// therefore weighs by area, however unevenly the points lie.
std::vector<CellSum> sumCells(const PointCloud& cloud)
{
    constexpr int kCells = 32; // along an edge; [tuned: points_test]
    const Box3d box = cloud.localBounds();
    const double cell = std::max(box.sizes().maxCoeff() / kCells, 1e-300);
    std::vector<CellSum> cells(kCells * kCells * kCells);
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        const Vec3d p = cloud.positions[i].cast<double>() - box.min();
        const Vec3d n = cloud.normals[i].cast<double>();
        const Vec3i at = (p / cell).cast<int>().cwiseMin(kCells - 1);
        CellSum& sum = cells[(at.x() * kCells + at.y()) * kCells + at.z()];
        sum.count += 1;
        sum.flux += p.dot(n);
        sum.position += p;
        sum.normal += n;
    }
    cells.erase(
        std::remove_if(cells.begin(), cells.end(), [](const CellSum& c) { return c.count == 0; }),
        cells.end());
    return cells;
}

} // namespace

bool pointsInward(const PointCloud& cloud)
{
    if (cloud.empty() || !cloud.hasNormals()) return false;
    const std::vector<CellSum> cells = sumCells(cloud);
    Vec3d middle = Vec3d::Zero(), openness = Vec3d::Zero();
    for (const CellSum& c : cells) {
        middle += c.position / c.count;
        openness += c.normal / c.count;
    }
    middle /= double(cells.size());
    double flux = 0, absoluteFlux = 0;
    for (const CellSum& c : cells) {
        const double f = (c.flux - middle.dot(c.normal)) / c.count;
        flux += f;
        absoluteFlux += std::abs(f);
    }
    // The vector area of a closed surface is zero, and only then is the volume one whatever the
    // middle: a bowl or a room's corner seen from inside is open, and its normals are right.
    // [tuned: points_test]
    constexpr double kOpen = 0.25, kClearly = 0.2;
    const bool closed = openness.norm() < kOpen * double(cells.size());
    return closed && flux < -kClearly * absoluteFlux;
}

void flipNormals(PointCloud& cloud)
{
    for (Vec3f& n : cloud.normals) n = -n;
}

} // namespace mpuvdb
