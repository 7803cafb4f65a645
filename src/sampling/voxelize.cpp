#include "distance/triangle_band.h"
#include "explain_mesh.h"
#include "grid/band_limits.h"
#include "grid/transform_lattice.h"
#include "mesh_signs.h"
#include <mpuvdb/distances.h>
#include <mpuvdb/error.h>
#include <mpuvdb/explained.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/sampling.h>

#include <cmath>
#include <fmt/format.h>
#include <openvdb/tools/SignedFloodFill.h>

namespace mpuvdb
{
namespace
{

/// Corners of a mesh in voxels of the lattice.
class IndexMesh
{
public:
    IndexMesh(const Mesh& mesh, const Lattice& lattice)
        : mMesh(mesh), mShift((mesh.frame - lattice.origin) / lattice.voxelSize),
          mScale(1 / lattice.voxelSize)
    {
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

void requireValidMesh(const Mesh& mesh)
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

/// Area of all triangles, voxels squared. @throws LimitError beyond the index range.
double areaOf(const IndexMesh& mesh, const Mesh& triangles, double voxelSize)
{
    constexpr double kMaxIndex = 1 << 23; ///< of a voxel [derived: 24 significant bits of floats]
    double area = 0;
    for (const Mesh::Triangle& t : triangles.triangles) {
        const Vec3d a = mesh.at(t[0]), b = mesh.at(t[1]), c = mesh.at(t[2]);
        for (const Vec3d& p : {a, b, c})
            if (!(p.cwiseAbs().maxCoeff() < kMaxIndex))
                throw LimitError(fmt::format("mesh: reaches to voxel ({:.0f}, {:.0f}, {:.0f}) of "
                                             "size {}, beyond the index range. Use larger voxels",
                                             p[0], p[1], p[2], voxelSize));
        area += 0.5 * (b - a).cross(c - a).norm();
    }
    return area;
}

void requireMemory(double area, std::size_t triangles, const SampleSettings& settings)
{
    // Memory of the band's blocks, bytes per voxel; their excess over the band's width, voxels; and
    // memory of the trees, neighbors and winding numbers, bytes per triangle. [tuned:
    // estimate_test, and meshes of 20 thousand to 1.1 million triangles at 100 to 800 voxels, to a
    // quarter]
    constexpr double kBytesPerVoxel = 4.8, kBlocksReach = 12, kBytesPerTriangle = 185;
    const double bytes = area * (2 * settings.halfWidth + kBlocksReach) * kBytesPerVoxel +
                         double(triangles) * kBytesPerTriangle;
    if (settings.maxBytes && bytes > double(settings.maxBytes))
        throw LimitError(fmt::format("mesh: about {:.1f} MB are needed at voxels of size {}, and "
                                     "the limit is {:.1f} MB. Use larger voxels or a larger "
                                     "--max-memory",
                                     bytes / 1e6, settings.lattice.voxelSize,
                                     double(settings.maxBytes) / 1e6));
}

std::string emptyText(const SolidBoundary::Report& report)
{
    if (report.openEdges > 0)
        return fmt::format(
            "mesh: encloses nothing: it is open ({} of its edges bound holes). Close "
            "its holes, or reconstruct a surface from its points",
            report.openEdges);
    return "mesh: encloses nothing: its faces cancel, since each is there for both sides, or lie "
           "in one plane. Export one side of each face, turned outward, or thicken it";
}

} // namespace

LevelSet voxelize(const Mesh& mesh, const SampleSettings& settings, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    const Lattice& lattice = settings.lattice;
    requireVoxelSize(lattice.voxelSize);
    requireHalfWidth(settings.halfWidth);
    progress.beginStage("voxelize");
    requireValidMesh(mesh);
    const IndexMesh indexMesh(mesh, lattice);
    requireMemory(areaOf(indexMesh, mesh, lattice.voxelSize), mesh.triangles.size(), settings);
    progress.check();
    const double h = lattice.voxelSize;
    const SolidBoundary solid(mesh, h, progress);
    if (solid.isEmpty()) throw InputError(emptyText(solid.report()));
    const PlacedTriangles triangles{solid.tree(), mesh.frame, lattice.origin - mesh.frame, h};
    const auto grid = openvdb::FloatGrid::create(float(settings.halfWidth * h));
    for (auto& leaf : leavesNear(triangles, settings.halfWidth, progress))
        grid->tree().addLeaf(leaf.release());
    repairSigns(grid->tree(), triangles, solid, progress);
    progress.check();
    openvdb::tools::signedFloodFill(grid->tree());
    setLattice(*grid, lattice);
    grid->setGridClass(openvdb::GRID_LEVEL_SET);
    grid->setName(settings.name);
    progress.beginStage("explain");
    auto explained = std::make_shared<Explained>();
    explained->by = explainMesh(solid, triangles, LevelSet(grid), progress);
    progress.endStage();
    return LevelSet(grid, std::move(explained));
}

} // namespace mpuvdb
