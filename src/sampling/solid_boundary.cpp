#include "solid_boundary.h"

#include "convex_pieces.h"
#include "core/union_find.h"
#include "mesh_patches.h"
#include "triangle_contacts.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <tbb/parallel_for.h>
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
constexpr double kRoundings = 4;

ContactLengths lengthsFor(const Mesh& mesh, double voxelSize)
{
    float largest = 0;
    for (const Vec3f& p : mesh.positions) largest = std::max(largest, p.cwiseAbs().maxCoeff());
    const double rounding = kRoundings * double(std::numeric_limits<float>::epsilon() * largest);
    return {std::max(kTouch * voxelSize, rounding), kPoint * voxelSize};
}

/// Winding numbers on the two sides of a face.
struct Sides {
    double front = 0, back = 0; ///< the side that the normal points to, and the other

    bool bounds(double sign) const { return (sign * front > 0.5) != (sign * back > 0.5); }
    bool facesInward(double sign) const { return sign * front > 0.5; }
    bool isWithin(double sign) const { return sign * front > 0.5 && sign * back > 0.5; }
    /// The smallest change of a side that changes what the face bounds.
    double margin() const { return std::min(std::abs(front - 0.5), std::abs(back - 0.5)); }
};

/// Difference of a winding number from 1/2, its value on the back of a plane sheet, that says
/// nothing. [derived: a hole as wide as 100 voxels is closed a quarter of a voxel from there]
constexpr double kFlat = 1e-3;

using Corners = TriangleTree::Corners;

/// A piece of a triangle that meets others.
struct Piece {
    Corners corners;
    std::uint32_t triangle; ///< of the mesh
    Sides sides;
    bool isCut = false; ///< from a triangle of which only a part bounds the solid
};

/// Computes the winding numbers on the sides of faces, each from the last one.
class Walk
{
public:
    Walk(const WindingNumber& winding, const ContactLengths& lengths)
        : mWinding(winding), mStep(2 * lengths.touch)
    {
    }

    /// The sides of a face at @a place. @param area  along its normal; 0: no sides.
    /// @param apart  what they differ by, if that is known.
    Sides sidesAt(const Vec3d& place, const Vec3d& area, std::optional<double> apart = {})
    {
        const double size = area.norm();
        if (!(size > 0)) return {};
        const Vec3d step = mStep / size * area;
        Sides sides;
        sides.front = numberAt(place + step);
        sides.back = apart ? sides.front + *apart : numberAt(place - step);
        return sides;
    }

private:
    double numberAt(const Vec3d& p)
    {
        mNumber = mLast ? mWinding.from(*mLast, mNumber, p) : mWinding.at(p);
        mLast = p;
        return mNumber;
    }

    const WindingNumber& mWinding;
    double mStep; ///< distance from the face, world units: beyond faces that touch
    std::optional<Vec3d> mLast;
    double mNumber = 0; ///< there
};

/// Finds the sides of triangles and of their pieces.
class Faces
{
public:
    /// @param mixed  length, world units, down to which triangles are cut that bound the solid only
    /// in part, as those of open meshes may; 0: all of a region of triangles has the same sides.
    Faces(const OrientedTriangles& triangles, const TriangleTree& tree,
          const WindingNumber& winding, const ContactLengths& lengths, double mixed)
        : mTriangles(triangles), mTree(tree), mWinding(winding), mLengths(lengths), mMixed(mixed)
    {
    }

    void find(const std::vector<Contact>& contacts, Interrupter& progress)
    {
        findFirst(contacts);
        joinRegions();
        progress.check();
        if (mMixed > 0)
            findRims(progress);
        else
            findRegionSides();
        progress.check();
        cut(contacts, progress);
    }

    /// Call f(corners, sides, triangle of the mesh) for all triangles that meet no others, and for
    /// the pieces of those that do.
    template <typename F>
    void forEach(const F& f) const
    {
        const Mesh& mesh = mTriangles.mesh;
        for (std::uint32_t n = 0; n < mesh.triangles.size(); ++n) {
            if (mMixed > 0 || isTouched(n)) continue;
            const Mesh::Triangle& t = mesh.triangles[n];
            f(Corners{mesh.positions[t[0]], mesh.positions[t[1]], mesh.positions[t[2]]},
              mSides[mRegion[n]], n);
        }
        for (const Piece& piece : mPieces) f(piece.corners, piece.sides, piece.triangle);
    }

    /// Segments near all lines between faces that bound the solid and others.
    std::vector<std::array<Vec3d, 2>> limits() const
    {
        std::vector<std::array<Vec3d, 2>> limits;
        std::vector<std::uint8_t> kinds(mTriangles.mesh.triangles.size(), 0);
        for (const Piece& piece : mPieces) {
            kinds[piece.triangle] |= std::uint8_t(piece.sides.bounds(1) ? 1 : 2);
            const Vec3d at =
                ((piece.corners[0] + piece.corners[1] + piece.corners[2]) / 3).cast<double>();
            if (piece.isCut) limits.push_back({at, at});
        }
        for (std::uint32_t n = 0; n < kinds.size(); ++n)
            for (std::size_t k = 0; k < 3; ++k) {
                const std::uint32_t m = mTriangles.neighbors[n][k];
                if (m == kNoTriangle || (m > n && (kinds[n] | kinds[m]) == 3))
                    limits.push_back({corner(n, k), corner(n, (k + 1) % 3)});
            }
        return limits;
    }

    /// Whether predicate(sides) holds for some triangle, or piece of one.
    template <typename P>
    bool any(const P& predicate) const
    {
        return std::any_of(mSides.begin(), mSides.end(), predicate) ||
               std::any_of(mPieces.begin(), mPieces.end(),
                           [&](const Piece& piece) { return predicate(piece.sides); });
    }

private:
    Vec3d corner(std::uint32_t n, std::size_t k) const
    {
        return mTriangles.mesh.positions[mTriangles.mesh.triangles[n][k]].cast<double>();
    }
    Vec3d areaVector(std::uint32_t n) const
    {
        return (corner(n, 1) - corner(n, 0)).cross(corner(n, 2) - corner(n, 0)) / 2;
    }

    void findFirst(const std::vector<Contact>& contacts)
    {
        mFirst.assign(mTriangles.mesh.triangles.size() + 1, 0);
        for (const Contact& c : contacts) ++mFirst[c.triangle + 1];
        for (std::size_t n = 1; n < mFirst.size(); ++n) mFirst[n] += mFirst[n - 1];
    }
    bool isTouched(std::uint32_t n) const { return mFirst[n] != mFirst[n + 1]; }

    /// Triangles that meet no others, and their neighbors that meet none, have the same sides.
    void joinRegions()
    {
        const std::size_t count = mTriangles.mesh.triangles.size();
        UnionFind regions(count);
        for (std::uint32_t n = 0; n < count; ++n) {
            if (isTouched(n)) continue;
            for (const std::uint32_t m : mTriangles.neighbors[n])
                if (m != kNoTriangle && m < n && !isTouched(m)) regions.join(n, m);
        }
        mRegion.assign(count, kNoTriangle);
        std::vector<std::uint32_t> faceOf(count, kNoTriangle);
        for (std::uint32_t n = 0; n < count; ++n) {
            if (isTouched(n)) continue;
            std::uint32_t& face = faceOf[regions.find(n)];
            if (face == kNoTriangle) {
                face = std::uint32_t(mLargest.size());
                mLargest.push_back(n);
            }
            mRegion[n] = face;
            if (areaVector(n).squaredNorm() > areaVector(mLargest[face]).squaredNorm())
                mLargest[face] = n;
        }
    }

    void findRegionSides()
    {
        mSides.resize(mLargest.size());
        tbb::parallel_for(std::size_t(0), mSides.size(), [&](std::size_t f) {
            const std::uint32_t n = mLargest[f];
            mSides[f] =
                Walk(mWinding, mLengths)
                    .sidesAt((corner(n, 0) + corner(n, 1) + corner(n, 2)) / 3, areaVector(n));
        });
    }

    void cut(const std::vector<Contact>& contacts, Interrupter& progress)
    {
        /// Triangles of a task, mostly near each other. [free: time]
        constexpr std::size_t kTogether = 64;
        std::vector<std::uint32_t> touched;
        for (std::size_t slot = 0; slot < mTree.size(); ++slot)
            if (mMixed > 0 || isTouched(mTree.triangle(slot)))
                touched.push_back(mTree.triangle(slot));
        std::vector<std::vector<Piece>> pieces((touched.size() + kTogether - 1) / kTogether);
        tbb::parallel_for(std::size_t(0), pieces.size(), [&](std::size_t some) {
            Walk walk(mWinding, mLengths);
            Known known;
            const std::size_t end = std::min((some + 1) * kTogether, touched.size());
            for (std::size_t t = some * kTogether; t < end; ++t) {
                progress.check();
                if (mMixed > 0 && !isTouched(touched[t]))
                    addMixed({corner(touched[t], 0), corner(touched[t], 1), corner(touched[t], 2)},
                             touched[t], walk, known, pieces[some]);
                else
                    addPieces(touched[t], contacts, walk, pieces[some]);
            }
        });
        for (const auto& some : pieces) mPieces.insert(mPieces.end(), some.begin(), some.end());
    }

    void addPieces(std::uint32_t n, const std::vector<Contact>& contacts, Walk& walk,
                   std::vector<Piece>& pieces) const
    {
        const Vec3d origin = corner(n, 0), normal = areaVector(n).normalized();
        const Vec3d u = (corner(n, 1) - origin).normalized(), v = normal.cross(u);
        const auto flat = [&](const Vec3d& p) {
            return Vec2d(u.dot(p - origin), v.dot(p - origin));
        };
        std::vector<PlaneSegment> segments;
        for (std::size_t c = mFirst[n]; c < mFirst[n + 1]; ++c)
            if (contacts[c].cuts)
                segments.push_back({flat(contacts[c].segment[0]), flat(contacts[c].segment[1])});
        const auto place = [&](const Vec2d& p) { return Vec3d(origin + p[0] * u + p[1] * v); };
        for (const PlanePolygon& polygon :
             cutAlong({flat(corner(n, 0)), flat(corner(n, 1)), flat(corner(n, 2))},
                      std::move(segments), mLengths.point)) {
            if (mMixed > 0) {
                Known known;
                for (std::size_t k = 2; k < polygon.size(); ++k)
                    addMixed({place(polygon[0]), place(polygon[k - 1]), place(polygon[k])}, n, walk,
                             known, pieces);
                continue;
            }
            const Sides sides = walk.sidesAt(place(middleOf(polygon)), normal);
            for (std::size_t k = 2; k < polygon.size(); ++k)
                pieces.push_back(
                    {{place(polygon[0]).cast<float>(), place(polygon[k - 1]).cast<float>(),
                      place(polygon[k]).cast<float>()},
                     n,
                     sides});
        }
    }

    using Exact = std::array<Vec3d, 3>;

    /// The edges without a neighbor, as triangles without an area, under a tree.
    void findRims(Interrupter& progress)
    {
        Mesh rims;
        for (std::uint32_t n = 0; n < mTriangles.neighbors.size(); ++n)
            for (std::size_t k = 0; k < 3; ++k) {
                if (mTriangles.neighbors[n][k] != kNoTriangle) continue;
                const auto first = std::uint32_t(rims.positions.size());
                for (const std::size_t m : {k, (k + 1) % 3})
                    rims.positions.push_back(corner(n, m).cast<float>());
                rims.triangles.push_back({first, first + 1, first + 1});
            }
        if (!rims.triangles.empty()) mRims = std::make_unique<TriangleTree>(rims, progress);
    }

    /// The sides of a face, and how far from a place on it they bound the same.
    struct Known {
        std::uint32_t region = kNoTriangle;
        Vec3d place;
        Sides sides;
        double radius = 0;

        bool holds(const Exact& t) const
        {
            return std::all_of(t.begin(), t.end(), [&](const Vec3d& p) {
                return (p - place).squaredNorm() <= radius * radius;
            });
        }
    };

    /// The sides at a place of a triangle of an open mesh.
    Known knownAt(std::uint32_t n, const Vec3d& place, Walk& walk) const
    {
        /// Rims whose winding numbers may add up. [derived: those of two gaps side by side]
        constexpr double kRims = 4;
        Known known;
        known.region = mRegion[n];
        known.place = place;
        // Where it meets no other, they differ by itself alone.
        known.sides = isTouched(n) ? walk.sidesAt(place, areaVector(n))
                                   : walk.sidesAt(place, areaVector(n), 1);
        for (double* side : {&known.sides.front, &known.sides.back})
            if (std::abs(*side - 0.5) < kFlat) *side = 0.5;
        if (!mRims) return known;
        // At a distance d from a straight rim the number changes by 1 / (2 pi d) per length.
        std::size_t slot = 0;
        const double half = std::sqrt(mRims->squaredDistance(place, slot)) / 2;
        known.radius = half * std::min(1.0, 2 * M_PI / kRims * known.sides.margin());
        return known;
    }

    /// Add a triangle, in pieces if only a part of it bounds the solid. @param known  the last
    /// sides found, which may hold for it.
    void addMixed(const Exact& t, std::uint32_t n, Walk& walk, Known& known,
                  std::vector<Piece>& pieces) const
    {
        if (known.region == mRegion[n] && mRegion[n] != kNoTriangle && known.holds(t)) {
            pieces.push_back({rounded(t), n, known.sides});
            return;
        }
        const auto first = std::ptrdiff_t(pieces.size());
        known = cutMixed(t, n, walk, pieces);
        const bool bounds = pieces[std::size_t(first)].sides.bounds(1);
        if (std::any_of(pieces.begin() + first, pieces.end(),
                        [&](const Piece& piece) { return piece.sides.bounds(1) != bounds; }))
            return;
        pieces.resize(std::size_t(first) + 1);
        pieces.back().corners = rounded(t);
        pieces.back().isCut = false;
    }

    /// Halve a triangle until its sides change less from place to place than would change what it
    /// bounds, or it is small. @return the sides of its middle.
    Known cutMixed(const Exact& t, std::uint32_t n, Walk& walk, std::vector<Piece>& pieces,
                   int depth = 0) const
    {
        const Vec3d middle = (t[0] + t[1] + t[2]) / 3;
        std::size_t k = 0; // the longest side
        for (std::size_t m = 1; m < 3; ++m)
            if ((t[(m + 1) % 3] - t[m]).norm() > (t[(k + 1) % 3] - t[k]).norm()) k = m;
        const Known known = knownAt(n, middle, walk);
        const bool isSmall = !((t[(k + 1) % 3] - t[k]).norm() > mMixed);
        double low = known.sides.front, high = low, margin = known.sides.margin();
        const bool isSure = isSmall || known.holds(t);
        for (std::size_t m = 0; m < 3 && !isSure && high - low <= margin; ++m) {
            const Sides other = knownAt(n, (t[m] + middle) / 2, walk).sides;
            low = std::min(low, other.front);
            high = std::max(high, other.front);
            margin = std::min(margin, other.margin());
        }
        if (isSure || high - low <= margin) {
            pieces.push_back({rounded(t), n, known.sides, isSmall && depth > 0});
            return known;
        }
        const Vec3d cut = (t[k] + t[(k + 1) % 3]) / 2;
        cutMixed({t[k], cut, t[(k + 2) % 3]}, n, walk, pieces, depth + 1);
        cutMixed({cut, t[(k + 1) % 3], t[(k + 2) % 3]}, n, walk, pieces, depth + 1);
        return known;
    }

    static Corners rounded(const Exact& t)
    {
        return {t[0].cast<float>(), t[1].cast<float>(), t[2].cast<float>()};
    }

    /// The centroid of a polygon.
    static Vec2d middleOf(const PlanePolygon& polygon)
    {
        Vec2d sum = Vec2d::Zero();
        double size = 0;
        for (std::size_t k = 2; k < polygon.size(); ++k) {
            const Vec2d a = polygon[k - 1] - polygon[0], b = polygon[k] - polygon[0];
            const double area = a[0] * b[1] - a[1] * b[0];
            size += area;
            sum += area / 3 * (a + b);
        }
        return size > 0 ? Vec2d(polygon[0] + sum / size) : polygon[0];
    }

    const OrientedTriangles& mTriangles;
    const TriangleTree& mTree;
    const WindingNumber& mWinding;
    const ContactLengths& mLengths;
    double mMixed;
    std::unique_ptr<const TriangleTree> mRims; ///< null without any, or if they do not matter
    std::vector<std::uint32_t> mFirst;         ///< first contact, by triangle
    std::vector<std::uint32_t> mRegion;        ///< region, by triangle that meets no other
    std::vector<std::uint32_t> mLargest;       ///< largest triangle, by region
    std::vector<Sides> mSides;                 ///< by region
    std::vector<Piece> mPieces;                ///< of the triangles that meet others
};

double areaOf(const Corners& t)
{
    const Vec3d a = t[0].cast<double>();
    return (t[1].cast<double>() - a).cross(t[2].cast<double>() - a).norm() / 2;
}

double volumeOf(const Corners& t)
{
    return t[0].cast<double>().dot(t[1].cast<double>().cross(t[2].cast<double>())) / 6;
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

/// Add the areas and volumes of the pieces to @a report, and count parts and cavities.
void measure(const OrientedTriangles& triangles, const Faces& faces, double sign,
             UnionFind surfaces, SolidBoundary::Report& report)
{
    std::unordered_map<std::uint32_t, double> volumes; // of surfaces
    faces.forEach([&](const Corners& corners, const Sides& sides, std::uint32_t triangle) {
        const double area = areaOf(corners);
        if (!sides.bounds(sign)) {
            (sides.isWithin(sign) ? report.areaWithin : report.areaOfNothing) += area;
            return;
        }
        // Coincident faces share the boundary.
        const double layers = sign * (sides.back - sides.front);
        const double times = triangles.multiplicity.empty() ? 1 : triangles.multiplicity[triangle];
        const double share = times * layers / std::max(1.0, layers * layers);
        const double volume = sign * volumeOf(corners) * std::abs(share);
        report.area += area * share;
        report.volume += volume;
        volumes[surfaces.find(triangle)] += volume;
    });
    for (const auto& [surface, volume] : volumes) ++(volume > 0 ? report.parts : report.cavities);
}

/// The value of SolidBoundary::Report::bending.
double bendingOf(const OrientedTriangles& triangles, const std::vector<Contact>& contacts)
{
    const auto at = [&](std::uint32_t vertex) {
        return Vec3d(triangles.mesh.positions[vertex].cast<double>());
    };
    const auto normalOf = [&](const Mesh::Triangle& t) {
        return Vec3d((at(t[1]) - at(t[0])).cross(at(t[2]) - at(t[0])));
    };
    double sum = 0;
    for (std::uint32_t n = 0; n < triangles.neighbors.size(); ++n) {
        const Mesh::Triangle& t = triangles.mesh.triangles[n];
        const Vec3d normal = normalOf(t);
        for (std::size_t k = 0; k < 3; ++k) {
            const std::uint32_t m = triangles.neighbors[n][k];
            if (m == kNoTriangle || m < n) continue;
            const Vec3d other = normalOf(triangles.mesh.triangles[m]);
            const double angle = std::atan2(normal.cross(other).norm(), normal.dot(other));
            sum += angle * (at(t[(k + 1) % 3]) - at(t[k])).norm();
        }
    }
    for (const Contact& c : contacts) // each is there for both triangles
        if (c.cuts) sum += M_PI / 4 * (c.segment[1] - c.segment[0]).norm();
    return sum;
}

/// The pieces that bound the solid, facing outward.
Mesh boundaryOf(const Faces& faces, double sign, const Vec3d& frame)
{
    Mesh mesh;
    mesh.frame = frame;
    faces.forEach([&](const Corners& corners, const Sides& sides, std::uint32_t) {
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
    : mTriangles(orientTriangles(mesh, repair ? Copies::Merge : Copies::Add, progress))
{
    if (repair) repairPatches(lattice, *repair, progress);
    mReport.openEdges = mTriangles.openEdges;
    mReport.turned = mTriangles.turned;
    if (mTriangles.mesh.triangles.empty()) return;
    mWhole = std::make_shared<const TriangleTree>(mTriangles.mesh, progress);
    mBox = {mWhole->box().min().cast<double>(), mWhole->box().max().cast<double>()};
    mWinding = std::make_unique<const WindingNumber>(*mWhole, mTriangles);
    progress.check();
    const ContactLengths lengths = lengthsFor(mTriangles.mesh, lattice.voxelSize);
    const std::vector<Contact> contacts = findContacts(mTriangles, *mWhole, lengths, progress);
    const bool closes = repair && (isOpen || !mTriangles.isClosed());
    Faces faces(mTriangles, *mWhole, *mWinding, lengths,
                closes ? mixedFor(mTriangles.mesh, mBox, lattice.voxelSize) : 0);
    faces.find(contacts, progress);
    const auto isSolid = [&](double sign) {
        return faces.any([&](const Sides& s) { return s.bounds(sign); });
    };
    mReport.insideOut = !closes && !isSolid(1) && isSolid(-1);
    const double sign = mReport.insideOut ? -1 : 1;
    mReport.isCut = closes || !contacts.empty();
    mReport.bending = bendingOf(mTriangles, contacts);
    measure(mTriangles, faces, sign, surfacesOf(mTriangles, contacts), mReport);
    if (!isSolid(sign)) {
        if (repair && repair->thickness > 0 && !mSheets) makeSheet();
        return;
    }
    const bool isWhole =
        !closes && contacts.empty() && !mReport.insideOut &&
        !faces.any([](const Sides& s) { return !s.bounds(1) || s.facesInward(1); });
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
    Mesh rest, sheets;
    rest.frame = mTriangles.mesh.frame;
    rest.positions = sheets.positions = mTriangles.mesh.positions;
    std::vector<std::uint8_t> isCounted(patches.enclosed.size(), 0);
    for (std::uint32_t n = 0; n < patches.patchOf.size(); ++n) {
        const std::uint32_t patch = patches.patchOf[n];
        const Mesh::Triangle& t = mTriangles.mesh.triangles[n];
        const bool isSheet = repair.thickness > 0 && patches.isSheet(patch);
        if (!isSheet && !patches.isInnerWall(patch)) {
            rest.triangles.push_back(t);
            continue;
        }
        if (!isCounted[patch]) ++(isSheet ? mReport.sheets : mReport.innerWalls);
        isCounted[patch] = 1;
        const double area =
            areaOf({rest.positions[t[0]], rest.positions[t[1]], rest.positions[t[2]]});
        (isSheet ? mReport.sheetArea : mReport.areaWithin) += area;
        if (isSheet) sheets.triangles.push_back(t);
    }
    if (!sheets.triangles.empty()) mSheets = std::make_unique<const TriangleTree>(sheets, progress);
    if (mReport.sheets + mReport.innerWalls == 0) return;
    const std::uint64_t turned = mTriangles.turned;
    mTriangles = orientTriangles(rest, Copies::Merge, progress);
    mTriangles.turned = turned;
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
        mReport.volume += volumeOf(corners);
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
