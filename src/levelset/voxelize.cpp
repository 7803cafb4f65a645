#include "mesh_signs.h"
#include "transform_lattice.h"
#include "triangle_band.h"

#include <mpuvdb/error.h>
#include <mpuvdb/operations.h>
#include <mpuvdb/progress.h>

#include <fmt/format.h>
#include <openvdb/tools/MeshToVolume.h>
#include <openvdb/tools/SignedFloodFill.h>

#include <cmath>

namespace mpuvdb
{
namespace
{

/// Renormalising would move the surface of sound meshes to smooth bumps of unsound ones.
constexpr int kFlags = openvdb::tools::DISABLE_RENORMALIZATION;

/// Voxels: of the band in which meshToVolume knows what is inside. A wider one it makes by looking
/// at the triangles that neighbours know.
constexpr float kWidth = 1.5f;

/// OpenVDB's view of a mesh: corners in voxels of the lattice.
class IndexMesh
{
public:
    IndexMesh(const Mesh& mesh, const Lattice& lattice)
        : mMesh(mesh), mShift((mesh.frame - lattice.origin) / lattice.voxelSize),
          mScale(1 / lattice.voxelSize)
    {
    }
    std::size_t polygonCount() const { return mMesh.triangles.size(); }
    std::size_t pointCount() const { return mMesh.positions.size(); }
    std::size_t vertexCount(std::size_t /*polygon*/) const { return 3; }
    void getIndexSpacePoint(std::size_t polygon, std::size_t corner, openvdb::Vec3d& p) const
    {
        const Vec3d q = at(mMesh.triangles[polygon][corner]);
        p = {q[0], q[1], q[2]};
    }
    Vec3d at(std::size_t vertex) const
    {
        return mScale * mMesh.positions[vertex].cast<double>() + mShift;
    }

private:
    const Mesh& mMesh;
    Vec3d mShift;
    double mScale;
};

void demandMesh(const Mesh& mesh)
{
    if (mesh.triangles.empty())
        throw InputError("mesh: has no triangles, so that nothing is inside. Export its faces too, "
                         "or reconstruct a surface from its points");
    for (std::size_t i = 0; i < mesh.positions.size(); ++i)
        if (!mesh.world(i).allFinite())
            throw InputError(fmt::format("mesh: vertex {} is not finite. Export it again, or "
                                         "remove that vertex",
                                         i));
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
        for (const std::uint32_t corner : mesh.triangles[t])
            if (corner >= mesh.positions.size())
                throw InputError(fmt::format("mesh: triangle {} has vertex {} of {}: it is "
                                             "damaged. Export it again",
                                             t, corner, mesh.positions.size()));
}

/// Voxels squared, of all triangles. @throws LimitError beyond the index range.
double areaOf(const IndexMesh& mesh, const Mesh& triangles, double voxelSize)
{
    constexpr double kFar = 1 << 23; // meshToVolume's own steps are floats
    double area = 0;
    for (const Mesh::Triangle& t : triangles.triangles) {
        const Vec3d a = mesh.at(t[0]), b = mesh.at(t[1]), c = mesh.at(t[2]);
        for (const Vec3d& p : {a, b, c})
            if (!(p.cwiseAbs().maxCoeff() < kFar))
                throw LimitError(fmt::format("mesh: reaches to voxel ({:.0f}, {:.0f}, {:.0f}) of "
                                             "size {}, beyond the index range. Use larger voxels",
                                             p[0], p[1], p[2], voxelSize));
        area += 0.5 * (b - a).cross(c - a).norm();
    }
    return area;
}

void demandMemory(double area, std::size_t triangles, const SampleSettings& settings)
{
    // Distances and nearest triangles in all blocks that the bands meet, measured; the tree.
    constexpr double kBytesPerVoxel = 9, kBlocksReach = 20, kBytesPerTriangle = 60;
    const double bytes = area * (2 * settings.halfWidth + kBlocksReach) * kBytesPerVoxel +
                         double(triangles) * kBytesPerTriangle;
    if (settings.maxBytes && bytes > double(settings.maxBytes))
        throw LimitError(fmt::format("mesh: about {:.1f} MB are needed at voxels of size {}, and "
                                     "the limit is {:.1f} MB. Use larger voxels or a larger "
                                     "--max-memory",
                                     bytes / 1e6, settings.lattice.voxelSize,
                                     double(settings.maxBytes) / 1e6));
}

/// Whether there is an inside next to the mesh, and more than drops behind a hole's rim.
bool hasInside(const openvdb::FloatGrid& grid)
{
    constexpr std::size_t kShare = 100;
    constexpr double kNear = 1.5; // voxels: more than one, for faces that lie on voxels
    const double h = grid.voxelSize()[0];
    std::size_t near = 0, inside = 0;
    for (auto leaf = grid.tree().cbeginLeaf(); leaf; ++leaf)
        for (auto on = leaf->cbeginValueOn(); on; ++on)
            if (std::abs(double(*on)) < kNear * h) {
                ++near;
                inside += *on < 0;
            }
    return inside > near / kShare;
}

} // namespace

LevelSet voxelize(const Mesh& mesh, const SampleSettings& settings, Progress& progress)
{
    const Lattice& lattice = settings.lattice;
    demandVoxelSize(lattice.voxelSize);
    if (!(settings.halfWidth >= 1.5 && settings.halfWidth <= 100))
        throw UsageError(
            fmt::format("half-width is {} voxels; it must be in [1.5, 100]", settings.halfWidth));
    progress.beginStage("voxelize");
    demandMesh(mesh);
    const IndexMesh indexMesh(mesh, lattice);
    demandMemory(areaOf(indexMesh, mesh, lattice.voxelSize), mesh.triangles.size(), settings);
    progress.check();
    const double h = lattice.voxelSize;
    const auto transform = openvdb::math::Transform::createLinearTransform(h);
    const openvdb::FloatGrid::Ptr signs = openvdb::tools::meshToVolume<openvdb::FloatGrid>(
        progress, indexMesh, *transform, kWidth, kWidth, kFlags);
    progress.check();
    const PlacedTriangles triangles{{mesh, progress}, lattice.origin - mesh.frame, h};
    const auto grid = openvdb::FloatGrid::create(float(settings.halfWidth * h));
    for (auto& leaf : leavesNear(triangles, settings.halfWidth, progress))
        grid->tree().addLeaf(leaf.release());
    signDistances(grid->tree(), signs->tree(), triangles);
    progress.check();
    openvdb::tools::signedFloodFill(grid->tree());
    setLattice(*grid, lattice);
    if (!hasInside(*grid))
        throw InputError("mesh: encloses nothing at this voxel size: it is open, or thinner than a "
                         "voxel. Close its holes, use smaller voxels, or reconstruct a surface "
                         "from its points");
    grid->setGridClass(openvdb::GRID_LEVEL_SET);
    grid->setName(settings.name);
    progress.endStage();
    return LevelSet(grid);
}

} // namespace mpuvdb
