#include "solid_boundary.h"

#include "core/union_find.h"
#include "mesh_holes.h"
#include "mesh_patches.h"
#include "outer_walls.h"
#include "solid_faces.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>
#include <unordered_map>

namespace mpuvdb
{
namespace
{

/// Distance, voxels, below which places are one. [derived: a thousandth of kTouch, and far above
/// the rounding of doubles for a mesh of 2^23 voxels, the index range]
constexpr double kPoint = 1e-6;
/// Distance of two faces meant to touch, roundings of a mesh's largest coordinate as a float.
/// [derived: each of the two is rounded along three axes]
constexpr double kContactRoundings = 4;

ContactLengths lengthsFor(const Mesh& mesh, double voxelSize)
{
    float largest = 0;
    for (const Vec3f& p : mesh.positions) largest = std::max(largest, p.cwiseAbs().maxCoeff());
    const double rounding =
        kContactRoundings * double(std::numeric_limits<float>::epsilon() * largest);
    return {std::max(kTouch * voxelSize, rounding), kPoint * voxelSize};
}

double areaOf(const Corners& t)
{
    const Vec3d a = t[0].cast<double>();
    return (t[1].cast<double>() - a).cross(t[2].cast<double>() - a).norm() / 2;
}

/// Volume between a triangle and @a from.
double volumeOf(const Corners& t, const Vec3d& from)
{
    const Vec3d a = t[0].cast<double>() - from, b = t[1].cast<double>() - from;
    return a.dot(b.cross(t[2].cast<double>() - from)) / 6;
}

/// Orients a mesh. Copies of triangles are there where parts share faces, or were written twice by
/// mistake: that leaves the edges about them open. Faces for both sides are left to repair.
OrientedTriangles orient(const Mesh& mesh, bool repairs, Interrupter& progress)
{
    if (repairs) return orientTriangles(mesh, Copies::Merge, progress);
    OrientedTriangles added = orientTriangles(mesh, Copies::Add, progress);
    if (added.isClosed() || added.copies == 0 || added.cancelled > 0) return added;
    OrientedTriangles merged = orientTriangles(mesh, Copies::Merge, progress);
    return merged.openEdges < added.openEdges ? merged : added;
}

/// Joins the triangles of a mesh that are one surface: neighbors, and those that meet.
UnionFind surfacesOf(const OrientedTriangles& triangles, const std::vector<Contact>& contacts)
{
    UnionFind surfaces(triangles.mesh.triangles.size());
    for (std::uint32_t n = 0; n < triangles.neighbors.size(); ++n)
        for (const std::uint32_t m : triangles.neighbors[n])
            if (m != kNoTriangle) surfaces.join(n, m);
    for (const Contact& c : contacts) surfaces.join(c.triangle, c.other);
    return surfaces;
}

/// Whether a triangle of @a count bounds the solid.
std::vector<std::uint8_t> trianglesOf(const SolidFaces& faces, double sign, std::size_t count)
{
    std::vector<std::uint8_t> bounds(count, 0);
    faces.forEach([&](const Corners&, const FaceSides& sides, std::uint32_t triangle) {
        if (sides.bounds(sign)) bounds[triangle] = 1;
    });
    return bounds;
}

/// Add the areas and volumes of the pieces to @a report, and count parts and cavities.
/// @param middle  of the mesh: there what is lacking at gaps weighs least.
void measure(const OrientedTriangles& triangles, const SolidFaces& faces, double sign,
             const Vec3d& middle, const MeshHoles& holes, UnionFind surfaces,
             SolidBoundary::Report& report)
{
    holes.forEachGap([&](std::uint32_t n, std::uint32_t m, double) { surfaces.join(n, m); });
    std::unordered_map<std::uint32_t, double> volumes; // of surfaces
    faces.forEach([&](const Corners& corners, const FaceSides& sides, std::uint32_t triangle) {
        const double area = areaOf(corners);
        if (!sides.bounds(sign)) {
            (sides.isWithin(sign) ? report.areaWithin : report.areaOfNothing) += area;
            return;
        }
        // Coincident faces share the boundary. Beside gaps the sides are known to a part of one.
        const double layers = std::round(sides.back - sides.front);
        const double times = triangles.multiplicity.empty() ? 1 : triangles.multiplicity[triangle];
        const double share = times * layers / std::max(1.0, layers * layers);
        const double volume = sign * volumeOf(corners, middle) * std::abs(share);
        report.area += area * share;
        report.volume += volume;
        volumes[surfaces.find(triangle)] += volume;
    });
    report.volumeOfHoles = sign * holes.volume(middle);
    report.volume += report.volumeOfHoles;
    for (const auto& [surface, volume] : volumes) ++(volume > 0 ? report.parts : report.cavities);
}

/// The value of SolidBoundary::Report::bending.
double bendingOf(const OrientedTriangles& triangles, const std::vector<Contact>& contacts,
                 const MeshHoles& holes)
{
    const auto at = [&](std::uint32_t vertex) {
        return Vec3d(triangles.mesh.positions[vertex].cast<double>());
    };
    const auto normalOf = [&](std::uint32_t n) {
        const Mesh::Triangle& t = triangles.mesh.triangles[n];
        return Vec3d((at(t[1]) - at(t[0])).cross(at(t[2]) - at(t[0])));
    };
    double sum = 0;
    const auto add = [&](std::uint32_t n, std::uint32_t m, double length) {
        const Vec3d a = normalOf(n), b = normalOf(m);
        sum += std::atan2(a.cross(b).norm(), a.dot(b)) * length;
    };
    for (std::uint32_t n = 0; n < triangles.neighbors.size(); ++n) {
        const Mesh::Triangle& t = triangles.mesh.triangles[n];
        for (std::size_t k = 0; k < 3; ++k) {
            const std::uint32_t m = triangles.neighbors[n][k];
            if (m != kNoTriangle && m > n) add(n, m, (at(t[(k + 1) % 3]) - at(t[k])).norm());
        }
    }
    holes.forEachGap(add);
    for (const Contact& c : contacts) // each is there for both triangles
        if (c.cuts) sum += M_PI / 4 * (c.segment[1] - c.segment[0]).norm();
    return sum;
}

/// The pieces that bound the solid, facing outward.
Mesh boundaryOf(const SolidFaces& faces, double sign, const Vec3d& frame)
{
    Mesh mesh;
    mesh.frame = frame;
    faces.forEach([&](const Corners& corners, const FaceSides& sides, std::uint32_t) {
        if (!sides.bounds(sign) || !(areaOf(corners) > 0)) return;
        const auto first = std::uint32_t(mesh.positions.size());
        mesh.positions.insert(mesh.positions.end(), corners.begin(), corners.end());
        if (sides.facesInward(sign))
            mesh.triangles.push_back({first, first + 2, first + 1});
        else
            mesh.triangles.push_back({first, first + 1, first + 2});
    });
    return mesh;
}

/// Length down to which triangles are cut that bound the solid only in part, world units: a voxel,
/// and more for a mesh that fills its box with surface, so that there are no more pieces.
double mixedFor(const Mesh& mesh, const Box3d& box, double voxelSize)
{
    double area = 0;
    for (const Mesh::Triangle& t : mesh.triangles)
        area += areaOf({mesh.positions[t[0]], mesh.positions[t[1]], mesh.positions[t[2]]});
    const Vec3d s = box.sizes();
    const double ofBox = 2 * (s[0] * s[1] + s[1] * s[2] + s[2] * s[0]);
    return voxelSize * std::sqrt(std::max(1.0, area / std::max(ofBox, area * 1e-6)));
}

} // namespace

SolidBoundary::SolidBoundary(const Mesh& mesh, const Lattice& lattice, const RepairSettings* repair,
                             Interrupter& progress, bool isOpen)
    : mTriangles(orient(mesh, repair, progress))
{
    if (repair) repairPatches(lattice, *repair, progress);
    mReport.openEdges = mTriangles.openEdges;
    mReport.turned = mTriangles.turned;
    mReport.cancelled = mTriangles.cancelled;
    if (mTriangles.mesh.triangles.empty()) return;
    mWhole = std::make_shared<const TriangleTree>(mTriangles.mesh, progress);
    mBox = {mWhole->box().min().cast<double>(), mWhole->box().max().cast<double>()};
    mWinding = std::make_unique<const WindingNumber>(*mWhole, mTriangles);
    progress.check();
    const ContactLengths lengths = lengthsFor(mTriangles.mesh, lattice.voxelSize);
    const std::vector<Contact> contacts = findContacts(mTriangles, *mWhole, lengths, progress);
    const bool closes = repair && (isOpen || !mTriangles.isClosed());
    SolidFaces faces(mTriangles, *mWhole, *mWinding, lengths,
                     closes ? mixedFor(mTriangles.mesh, mBox, lattice.voxelSize) : 0);
    faces.find(contacts, progress);
    const auto isSolid = [&](double sign) {
        return faces.any([&](const FaceSides& s) { return s.bounds(sign); });
    };
    mReport.insideOut = !closes && !isSolid(1) && isSolid(-1);
    const double sign = mReport.insideOut ? -1 : 1;
    mReport.isCut = closes || !contacts.empty();
    mReport.isClosedAnew = closes;
    // Holes wider than a voxel are refused, or closed anew.
    const MeshHoles holes(mTriangles, trianglesOf(faces, sign, mTriangles.mesh.triangles.size()),
                          lattice.voxelSize, progress);
    mReport.bending = bendingOf(mTriangles, contacts, holes);
    measure(mTriangles, faces, sign, mBox.center(), holes, surfacesOf(mTriangles, contacts),
            mReport);
    if (!isSolid(sign)) {
        if (repair && repair->thickness > 0 && !mSheets) makeSheet();
        return;
    }
    const bool isWhole =
        !closes && contacts.empty() && !mReport.insideOut &&
        !faces.any([](const FaceSides& s) { return !s.bounds(1) || s.facesInward(1); });
    if (isWhole) {
        mTree = mWhole;
        return;
    }
    Mesh boundary = boundaryOf(faces, sign, mTriangles.mesh.frame);
    if (closes) addClosure(faces.limits(), lattice, boundary, progress);
    mTree = std::make_shared<const TriangleTree>(boundary, progress);
}

void SolidBoundary::repairPatches(const Lattice& lattice, const RepairSettings& repair,
                                  Interrupter& progress)
{
    mReport.copies = mTriangles.copies;
    if (mTriangles.mesh.triangles.empty()) return;
    const MeshPatches patches = turnPatches(mTriangles, lattice.voxelSize, progress);
    mReport.turnedPatches = patches.turned;
    const bool thickens = repair.thickness > 0;
    Mesh rest, walls;
    rest.frame = walls.frame = mTriangles.mesh.frame;
    rest.positions = walls.positions = mTriangles.mesh.positions;
    std::vector<std::uint32_t> ofWalls; // patches
    for (std::uint32_t n = 0; n < patches.patchOf.size(); ++n) {
        const std::uint32_t patch = patches.patchOf[n];
        const bool isWall = thickens ? patches.isWall[patch] : patches.isInnerWall(patch);
        (isWall ? walls : rest).triangles.push_back(mTriangles.mesh.triangles[n]);
        if (isWall) ofWalls.push_back(patch);
    }
    if (walls.triangles.empty()) return;
    const std::uint64_t turned = mTriangles.turned;
    mTriangles = orientTriangles(rest, Copies::Merge, progress);
    mTriangles.turned = turned;
    const OuterWalls outer = outerWalls(walls, mTriangles, lattice.voxelSize, progress);
    std::vector<std::uint8_t> kinds(patches.enclosed.size(), 0); // 1: of a wall, 2: outside
    for (std::size_t n = 0; n < ofWalls.size(); ++n)
        kinds[ofWalls[n]] |= std::uint8_t(thickens && outer.hasOutside[n] ? 2 : 1);
    for (const std::uint8_t kind : kinds)
        if (kind) ++(kind & 2 ? mReport.sheets : mReport.innerWalls);
    mReport.areaWithin += outer.areaWithin;
    if (!thickens || outer.mesh.triangles.empty()) return;
    mReport.sheetArea += outer.areaOutside;
    mSheets = std::make_unique<const TriangleTree>(outer.mesh, progress);
}

void SolidBoundary::makeSheet()
{
    mSheets = std::make_unique<const TriangleTree>(*mWhole);
    mTree = nullptr;
    mClosure = {};
    mReport.sheets = 1;
    mReport.sheetArea = 0;
    for (std::size_t slot = 0; slot < mSheets->size(); ++slot)
        mReport.sheetArea += areaOf(mSheets->corners(slot));
    mReport.volume = mReport.area = mReport.bending = 0;
    mReport.parts = mReport.cavities = 0;
    mReport.areaWithin = mReport.areaOfNothing = 0;
}

void SolidBoundary::addClosure(const std::vector<std::array<Vec3d, 2>>& starts,
                               const Lattice& lattice, Mesh& boundary, Interrupter& progress)
{
    const TriangleTree tree(boundary, progress);
    mClosure = closeHoles({*mWinding, tree, mBox, boundary.frame}, lattice, starts, progress);
    const auto first = std::uint32_t(boundary.positions.size());
    boundary.positions.insert(boundary.positions.end(), mClosure.positions.begin(),
                              mClosure.positions.end());
    for (const Mesh::Triangle& t : mClosure.triangles) {
        boundary.triangles.push_back({first + t[0], first + t[1], first + t[2]});
        const Corners corners = {mClosure.positions[t[0]], mClosure.positions[t[1]],
                                 mClosure.positions[t[2]]};
        mReport.area += areaOf(corners);
    }
    // Seams are at most as bent as creases, in each of their cells as long as its edges.
    mReport.bending += M_PI / 2 * lattice.voxelSize * double(mClosure.seam.size());
}

bool SolidBoundary::isInside(const Vec3d& place) const
{
    if (!mClosure.holes.empty() && !mBox.contains(place)) return false;
    return (mReport.insideOut ? -1 : 1) * mWinding->at(place) > 0.5;
}

} // namespace mpuvdb
