#include "core/whole_triangle.h"
#include "distance/restore_distance.h"
#include "distance/triangle_band.h"
#include "explain_mesh.h"
#include "grid/band_limits.h"
#include "grid/has_inside.h"
#include "grid/transform_lattice.h"
#include "mesh_signs.h"
#include "rounded_mesh.h"
#include <mpuvdb/distances.h>
#include <mpuvdb/error.h>
#include <mpuvdb/explained.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/sampling.h>

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <memory>
#include <openvdb/tools/Composite.h>
#include <openvdb/tools/SignedFloodFill.h>
#include <tbb/parallel_for.h>

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

void requireTriangles(const Mesh& mesh)
{
    if (mesh.triangles.empty())
        throw InputError("mesh: has no triangles, so that nothing is inside. Export its faces too, "
                         "or reconstruct a surface from its points");
}

void requireValidMesh(const Mesh& mesh)
{
    requireTriangles(mesh);
    for (std::size_t i = 0; i < mesh.positions.size(); ++i)
        if (!mesh.world(i).allFinite())
            throw InputError(fmt::format("mesh: vertex {} is not finite. Export it again, or "
                                         "repair it (--repair leaves out its triangles)",
                                         i));
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
        for (const std::uint32_t corner : mesh.triangles[t])
            if (corner >= mesh.positions.size())
                throw InputError(fmt::format("mesh: triangle {} has vertex {} of {}: it is "
                                             "damaged. Export it again, or repair it (--repair "
                                             "leaves out that triangle)",
                                             t, corner, mesh.positions.size()));
}

/// @a mesh without the triangles that have vertices that are not finite or not there.
Mesh withoutDamage(const Mesh& mesh)
{
    Mesh whole = wholeTriangles(mesh);
    if (whole.triangles.empty())
        throw InputError("mesh: all of its triangles have vertices that are not finite or not "
                         "there, so that nothing is left to repair. Export it again");
    return whole;
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

/// @param reach  voxels on either side of the triangles whose distances are needed.
void requireMemory(double area, std::size_t triangles, double reach, bool closesHoles,
                   const SampleSettings& settings)
{
    // Memory of the band's blocks, bytes per voxel; their excess over the band's width, voxels; and
    // memory of the trees, neighbors and winding numbers, bytes per triangle. [tuned:
    // estimate_test, and meshes of 20 thousand to 1.1 million triangles at 100 to 800 voxels, to a
    // quarter]
    constexpr double kBytesPerVoxel = 4.8, kBlocksReach = 12, kBytesPerTriangle = 185;
    // Memory of the cells and edges followed along a surface that closes holes, bytes for its area
    // in voxels squared; it is hardly larger than the mesh that ends at its rim. [derived: two hash
    // nodes of 40 bytes a cell, one and a half of 112 an edge, and two facets]
    constexpr double kBytesPerCell = 300;
    const double perArea = (2 * reach + kBlocksReach) * kBytesPerVoxel;
    const double bytes = area * (closesHoles ? 2 * perArea + kBytesPerCell : perArea) +
                         double(triangles) * kBytesPerTriangle;
    if (settings.maxBytes && bytes > double(settings.maxBytes))
        throw LimitError(fmt::format("mesh: about {:.1f} MB are needed at voxels of size {}, and "
                                     "the limit is {:.1f} MB. Use larger voxels or a larger "
                                     "--max-memory",
                                     bytes / 1e6, settings.lattice.voxelSize,
                                     double(settings.maxBytes) / 1e6));
}

std::string emptyText(const SolidBoundary::Report& report, bool isRepaired)
{
    if (isRepaired)
        return "mesh: encloses nothing, even with its holes closed: it is a surface without an "
               "inside. Thicken it (--thicken LENGTH), or reconstruct a surface from its points";
    if (report.openEdges > 0)
        return fmt::format(
            "mesh: encloses nothing: it is open ({} of its edges bound holes). Repair it (--repair "
            "closes holes, and --thicken LENGTH makes walls of open surfaces), or reconstruct a "
            "surface from its points",
            report.openEdges);
    return "mesh: encloses nothing: its faces cancel, since each is there for both sides, or lie "
           "in one plane. Export one side of each face, turned outward, or repair it (--repair "
           "merges such faces, and --thicken LENGTH makes walls of open surfaces)";
}

/// What the repair did. @throws InputError if a hole is wider than the limit.
MeshRepair repairOf(const SolidBoundary& solid, std::uint64_t dropped,
                    const RepairSettings& settings)
{
    const SolidBoundary::Report& report = solid.report();
    MeshRepair repair;
    repair.dropped = dropped;
    repair.copies = report.copies;
    repair.turned = report.turnedPatches;
    repair.innerWalls = report.innerWalls;
    repair.sheets = report.sheets;
    repair.sheetsArea = report.sheetArea;
    for (const ClosedHole& hole : solid.closure().holes) {
        ++repair.holes;
        repair.holesArea += hole.area;
        if (!(hole.width() > repair.widestHole)) continue;
        repair.widestHole = hole.width();
        repair.widestHoleAt = hole.box.center();
    }
    if (repair.widestHole > settings.holes) {
        const Vec3d& at = repair.widestHoleAt;
        throw InputError(fmt::format(
            "mesh: has a hole {:.4g} wide near ({:.6g}, {:.6g}, {:.6g}), and only holes up to "
            "{:.4g} are closed. Close it, or allow wider ones (--repair-holes)",
            repair.widestHole, at[0], at[1], at[2], settings.holes));
    }
    return repair;
}

/// The walls made of sheets: a distance of half the thickness from their triangles.
openvdb::FloatGrid::Ptr wallsOf(const PlacedTriangles& sheets, double thickness, double halfWidth,
                                Interrupter& progress)
{
    const double h = sheets.voxelSize;
    const auto background = float(halfWidth * h), half = float(thickness / 2);
    const auto grid = openvdb::FloatGrid::create(background);
    auto leaves = leavesNear(sheets, halfWidth + thickness / 2 / h, progress);
    tbb::parallel_for(std::size_t(0), leaves.size(), [&](std::size_t n) {
        openvdb::FloatTree::LeafNodeType& leaf = *leaves[n];
        for (openvdb::Index k = 0; k < openvdb::FloatTree::LeafNodeType::SIZE; ++k) {
            const float value = leaf.isValueOn(k) ? std::abs(leaf.getValue(k)) - half : background;
            if (std::abs(value) < background)
                leaf.setValueOn(k, value);
            else
                leaf.setValueOff(k, value < 0 ? -background : background);
        }
    });
    for (auto& leaf : leaves) grid->tree().addLeaf(leaf.release());
    openvdb::tools::signedFloodFill(grid->tree());
    return grid;
}

void requireNoHole(const std::optional<WayThrough>& way, const SolidBoundary& solid,
                   const Vec3d& frame)
{
    if (!way) return;
    const Vec3d at = way->at + frame;
    const std::uint64_t both = solid.report().cancelled;
    const std::string cancelled =
        both == 0 ? ""
                  : fmt::format(", and {} faces cancel, as they are there for both sides", both);
    throw InputError(fmt::format(
        "mesh: is open: near ({:.6g}, {:.6g}, {:.6g}) a hole wider than a voxel leads inside ({} "
        "of its edges bound holes{}). Repair it (--repair closes holes and merges faces), use "
        "larger voxels, or reconstruct a surface from its points",
        at[0], at[1], at[2], solid.report().openEdges, cancelled));
}

/// A mesh's solid, and the band about its boundary.
struct MadeSolid {
    std::unique_ptr<SolidBoundary> solid;
    openvdb::FloatGrid::Ptr grid; ///< null if only sheets are to be made walls
};

PlacedTriangles placedIn(const Lattice& lattice, const Vec3d& frame, const TriangleTree& tree)
{
    return {tree, frame, lattice.origin - frame, lattice.voxelSize};
}

/// The band about the boundary of @a made, whose grid it becomes. @return the way through it.
std::optional<WayThrough> makeBand(MadeSolid& made, const Mesh& mesh,
                                   const SampleSettings& settings, Interrupter& progress)
{
    const double h = settings.lattice.voxelSize;
    const PlacedTriangles triangles = placedIn(settings.lattice, mesh.frame, made.solid->tree());
    made.grid = openvdb::FloatGrid::create(float(settings.halfWidth * h));
    openvdb::FloatTree& tree = made.grid->tree();
    for (auto& leaf : leavesNear(triangles, settings.halfWidth, progress))
        tree.addLeaf(leaf.release());
    const auto way = repairSigns(tree, triangles, *made.solid, progress);
    progress.check();
    openvdb::tools::signedFloodFill(tree);
    return way;
}

/// @param isOpen  see SolidBoundary. @throws InputError if nothing is enclosed, or a way leads
/// inside.
MadeSolid makeSolid(const Mesh& mesh, const SampleSettings& settings, const RepairSettings* repair,
                    bool isOpen, Interrupter& progress)
{
    MadeSolid made;
    made.solid = std::make_unique<SolidBoundary>(mesh, settings.lattice, repair, progress, isOpen);
    const SolidBoundary& solid = *made.solid;
    if (solid.isEmpty() && !solid.sheets())
        throw InputError(emptyText(solid.report(), repair != nullptr));
    if (solid.isEmpty()) return made;
    const auto way = makeBand(made, mesh, settings, progress);
    if (!repair) requireNoHole(way, solid, mesh.frame);
    if (!way || isOpen || !solid.closure().holes.empty()) return made;
    return makeSolid(mesh, settings, repair, true, progress); // triangles of a region differ
}

/// A surface that is open and so flat that no voxel is inside becomes a sheet.
void makeSheetIfFlat(MadeSolid& made)
{
    if (!made.grid || made.solid->sheets() || hasInside(made.grid->tree())) return;
    made.solid->makeSheet();
    made.grid = nullptr;
}

/// Add the walls made of sheets, if there are some.
void addWalls(MadeSolid& made, const Mesh& mesh, const SampleSettings& settings, double thickness,
              Interrupter& progress)
{
    if (!made.solid->sheets()) return;
    const auto walls = wallsOf(placedIn(settings.lattice, mesh.frame, *made.solid->sheets()),
                               thickness, settings.halfWidth, progress);
    if (!made.grid) {
        made.grid = walls;
        return;
    }
    openvdb::tools::csgUnion(*made.grid, *walls);
    // Where the two meet, the larger distance within them is too small.
    restoreDistance(made.grid->tree(), settings.lattice.voxelSize, ValuesFrom::Distances, progress);
}

void requireThickness(const RepairSettings& repair, double voxelSize)
{
    constexpr double kThinnest = 2; ///< voxels [derived: one on either side of each voxel within]
    if (!(repair.holes >= 0))
        throw UsageError(fmt::format("holes {}: must be at least 0", repair.holes));
    if (!(repair.thickness == 0 || repair.thickness >= kThinnest * voxelSize) ||
        !std::isfinite(repair.thickness))
        throw UsageError(fmt::format("thickness {:.6g}: must be at least two voxels, {:.6g}. Use "
                                     "smaller voxels, or a larger --thicken",
                                     repair.thickness, kThinnest * voxelSize));
}

LevelSet voxelize(const Mesh& given, const SampleSettings& settings, const RepairSettings* repair,
                  Interrupter& progress)
{
    const Lattice& lattice = settings.lattice;
    const double h = lattice.voxelSize;
    requireVoxelSize(h);
    requireHalfWidth(settings.halfWidth);
    progress.beginStage("voxelize");
    Mesh whole;
    if (repair) {
        requireThickness(*repair, h);
        requireTriangles(given);
        whole = withoutDamage(given);
    } else {
        requireValidMesh(given);
    }
    const Mesh& mesh = repair ? whole : given;
    const IndexMesh indexMesh(mesh, lattice);
    requireMemory(areaOf(indexMesh, mesh, h), mesh.triangles.size(),
                  settings.halfWidth + (repair ? repair->thickness / 2 / h : 0), repair != nullptr,
                  settings);
    progress.check();
    MadeSolid made = makeSolid(mesh, settings, repair, false, progress);
    const SolidBoundary& solid = *made.solid;
    std::optional<MeshRepair> repaired;
    if (repair) {
        if (repair->thickness > 0) makeSheetIfFlat(made);
        repaired = repairOf(solid, given.triangles.size() - mesh.triangles.size(), *repair);
        addWalls(made, mesh, settings, repair->thickness, progress);
    }
    const openvdb::FloatGrid::Ptr& grid = made.grid;
    setLattice(*grid, lattice);
    grid->setGridClass(openvdb::GRID_LEVEL_SET);
    grid->setName(settings.name);
    progress.beginStage("explain");
    if (const auto warning = roundingOf(mesh, h)) progress.note(*warning);
    auto explained = std::make_shared<Explained>();
    MeshExplained e = explainMesh(solid, lattice.origin - mesh.frame, LevelSet(grid), progress);
    e.repair = repaired;
    if (repair && e.openEdges > 0 && e.partsOut == 0)
        throw InputError(emptyText(solid.report(), true));
    explained->by = std::move(e);
    progress.endStage();
    // A part thinner than a voxel may lie between voxels: a band without an inside is empty.
    if (!hasInside(grid->tree())) grid->clear();
    return LevelSet(grid, std::move(explained));
}

} // namespace

LevelSet voxelize(const Mesh& mesh, const SampleSettings& settings, Interrupter* interrupter)
{
    return voxelize(mesh, settings, nullptr, orSilent(interrupter));
}

LevelSet voxelize(const Mesh& mesh, const SampleSettings& settings, const RepairSettings& repair,
                  Interrupter* interrupter)
{
    return voxelize(mesh, settings, &repair, orSilent(interrupter));
}

} // namespace mpuvdb
