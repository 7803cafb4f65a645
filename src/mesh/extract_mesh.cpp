#include <mpuvdb/error.h>
#include <mpuvdb/mesh.h>
#include <mpuvdb/progress.h>

#include <fmt/format.h>
#include <openvdb/tools/VolumeToMesh.h>
#include <tbb/parallel_for.h>

#include <cmath>
#include <limits>

namespace mpuvdb
{
namespace
{

using openvdb::tools::VolumeToMesh;
constexpr std::size_t kGrain = 4096;

/// The quads' corners, in the extractor's order.
std::vector<openvdb::Vec4I> gatherQuads(VolumeToMesh& mesher)
{
    const auto& pools = mesher.polygonPoolList();
    const std::size_t poolCount = mesher.polygonPoolListSize();
    std::vector<std::size_t> starts(poolCount + 1, 0);
    for (std::size_t p = 0; p < poolCount; ++p) starts[p + 1] = starts[p] + pools[p].numQuads();
    std::vector<openvdb::Vec4I> quads(starts.back());
    tbb::parallel_for(std::size_t(0), poolCount, [&](std::size_t p) {
        for (std::size_t q = 0; q < pools[p].numQuads(); ++q)
            quads[starts[p] + q] = pools[p].quad(q);
    });
    return quads;
}

/// Split along the shorter diagonal. Quads come clockwise seen from outside, and are turned here.
std::array<Mesh::Triangle, 2> split(const openvdb::Vec4I& quad, const std::vector<Vec3f>& positions)
{
    const auto [a, b, c, d] = std::array{quad[3], quad[2], quad[1], quad[0]};
    const float ac = (positions[a] - positions[c]).squaredNorm();
    const float bd = (positions[b] - positions[d]).squaredNorm();
    if (ac <= bd) return {{{a, b, c}, {a, c, d}}};
    return {{{a, b, d}, {b, c, d}}};
}

} // namespace

Mesh extractMesh(const LevelSet& levelSet, Progress& progress)
{
    progress.beginStage("mesh", 3);
    Mesh mesh;
    const Lattice lattice = levelSet.lattice();
    const openvdb::CoordBBox box = levelSet.grid().evalActiveVoxelBoundingBox();
    if (box.empty()) {
        progress.endStage();
        return mesh;
    }
    // The extractor hands back floats, so it works in voxels about the middle of the grid.
    const openvdb::Vec3d centre = box.getCenter();
    const openvdb::Vec3d middle(std::round(centre[0]), std::round(centre[1]),
                                std::round(centre[2]));
    const auto local =
        openvdb::ConstPtrCast<openvdb::FloatGrid>(levelSet.grid().copyReplacingMetadataAndTransform(
            levelSet.grid(), openvdb::math::Transform::createLinearTransform(1.0)));
    local->transform().postTranslate(-middle);
    mesh.frame = lattice.origin + lattice.voxelSize * Vec3d(middle[0], middle[1], middle[2]);

    VolumeToMesh mesher;
    progress.check();
    mesher(*local);
    progress.advance();
    const std::size_t pointCount = mesher.pointListSize();
    if (pointCount > std::numeric_limits<std::uint32_t>::max())
        throw LimitError(fmt::format("mesh: would have {} vertices, more than 32 bits can number. "
                                     "Use larger voxels, or mesh parts",
                                     pointCount));
    mesh.positions.resize(pointCount);
    tbb::parallel_for(
        tbb::blocked_range<std::size_t>(0, pointCount, kGrain), [&](const auto& range) {
            progress.check();
            for (std::size_t i = range.begin(); i != range.end(); ++i) {
                const openvdb::Vec3s& p = mesher.pointList()[i];
                mesh.positions[i] = (lattice.voxelSize * Vec3d(p[0], p[1], p[2])).cast<float>();
            }
        });
    mesher.pointList().reset();
    progress.advance();

    const std::vector<openvdb::Vec4I> quads = gatherQuads(mesher);
    mesher.polygonPoolList().reset();
    mesh.triangles.resize(2 * quads.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, quads.size(), kGrain),
                      [&](const auto& range) {
                          progress.check();
                          for (std::size_t i = range.begin(); i != range.end(); ++i) {
                              const auto triangles = split(quads[i], mesh.positions);
                              mesh.triangles[2 * i] = triangles[0];
                              mesh.triangles[2 * i + 1] = triangles[1];
                          }
                      });
    progress.advance();
    progress.endStage();
    return mesh;
}

} // namespace mpuvdb
