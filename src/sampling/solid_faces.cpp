#include "solid_faces.h"

#include "convex_pieces.h"
#include "core/union_find.h"
#include <mpuvdb/interrupter.h>

#include <cmath>
#include <optional>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

/// Difference of a winding number from 1/2, its value on the back of a plane sheet, that says
/// nothing. [derived: a hole as wide as 100 voxels is closed a quarter of a voxel from there]
constexpr double kPlaneSide = 1e-3;

Corners rounded(const std::array<Vec3d, 3>& t)
{
    return {t[0].cast<float>(), t[1].cast<float>(), t[2].cast<float>()};
}

/// The centroid of a polygon.
Vec2d middleOf(const PlanePolygon& polygon)
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

} // namespace

/// Computes the winding numbers on the sides of faces, each from the last one.
class SolidFaces::Walk
{
public:
    Walk(const WindingNumber& winding, const ContactLengths& lengths)
        : mWinding(winding), mStep(2 * lengths.touch)
    {
    }

    /// The sides of a face at @a place. @param area  along its normal; 0: no sides.
    /// @param apart  what they differ by, if that is known.
    FaceSides sidesAt(const Vec3d& place, const Vec3d& area, std::optional<double> apart = {})
    {
        const double size = area.norm();
        if (!(size > 0)) return {};
        const Vec3d step = mStep / size * area;
        FaceSides sides;
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

void SolidFaces::find(const std::vector<Contact>& contacts, Interrupter& progress)
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

std::vector<std::array<Vec3d, 2>> SolidFaces::limits() const
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

void SolidFaces::findFirst(const std::vector<Contact>& contacts)
{
    mFirst.assign(mTriangles.mesh.triangles.size() + 1, 0);
    for (const Contact& c : contacts) ++mFirst[c.triangle + 1];
    for (std::size_t n = 1; n < mFirst.size(); ++n) mFirst[n] += mFirst[n - 1];
}

void SolidFaces::joinRegions()
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

void SolidFaces::findRegionSides()
{
    mSides.resize(mLargest.size());
    tbb::parallel_for(std::size_t(0), mSides.size(), [&](std::size_t f) {
        const std::uint32_t n = mLargest[f];
        mSides[f] = Walk(mWinding, mLengths)
                        .sidesAt((corner(n, 0) + corner(n, 1) + corner(n, 2)) / 3, areaVector(n));
    });
}

void SolidFaces::cut(const std::vector<Contact>& contacts, Interrupter& progress)
{
    /// Triangles of a task, mostly near each other. [free: time]
    constexpr std::size_t kTogether = 64;
    std::vector<std::uint32_t> touched;
    for (std::size_t slot = 0; slot < mTree.size(); ++slot)
        if (mMixed > 0 || isTouched(mTree.triangle(slot))) touched.push_back(mTree.triangle(slot));
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

void SolidFaces::addPieces(std::uint32_t n, const std::vector<Contact>& contacts, Walk& walk,
                           std::vector<Piece>& pieces) const
{
    const Vec3d origin = corner(n, 0), normal = areaVector(n).normalized();
    const Vec3d u = (corner(n, 1) - origin).normalized(), v = normal.cross(u);
    const auto flat = [&](const Vec3d& p) { return Vec2d(u.dot(p - origin), v.dot(p - origin)); };
    std::vector<PlaneSegment> segments;
    for (std::size_t c = mFirst[n]; c < mFirst[n + 1]; ++c)
        if (contacts[c].cuts)
            segments.push_back({flat(contacts[c].segment[0]), flat(contacts[c].segment[1])});
    const auto place = [&](const Vec2d& p) { return Vec3d(origin + p[0] * u + p[1] * v); };
    for (const PlanePolygon& polygon :
         cutAlong({flat(corner(n, 0)), flat(corner(n, 1)), flat(corner(n, 2))}, std::move(segments),
                  mLengths.point)) {
        if (mMixed > 0) {
            Known known;
            for (std::size_t k = 2; k < polygon.size(); ++k)
                addMixed({place(polygon[0]), place(polygon[k - 1]), place(polygon[k])}, n, walk,
                         known, pieces);
            continue;
        }
        const FaceSides sides = walk.sidesAt(place(middleOf(polygon)), normal);
        for (std::size_t k = 2; k < polygon.size(); ++k)
            pieces.push_back({{place(polygon[0]).cast<float>(), place(polygon[k - 1]).cast<float>(),
                               place(polygon[k]).cast<float>()},
                              n,
                              sides});
    }
}

void SolidFaces::findRims(Interrupter& progress)
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

SolidFaces::Known SolidFaces::knownAt(std::uint32_t n, const Vec3d& place, Walk& walk) const
{
    /// Rims whose winding numbers may add up. [derived: those of two gaps side by side]
    constexpr double kRims = 4;
    Known known;
    known.region = mRegion[n];
    known.place = place;
    // Where it meets no other, they differ by itself alone.
    known.sides =
        isTouched(n) ? walk.sidesAt(place, areaVector(n)) : walk.sidesAt(place, areaVector(n), 1);
    for (double* side : {&known.sides.front, &known.sides.back})
        if (std::abs(*side - 0.5) < kPlaneSide) *side = 0.5;
    if (!mRims) return known;
    // At a distance d from a straight rim the number changes by 1 / (2 pi d) per length.
    std::size_t slot = 0;
    const double half = std::sqrt(mRims->squaredDistance(place, slot)) / 2;
    known.radius = half * std::min(1.0, 2 * M_PI / kRims * known.sides.margin());
    return known;
}

void SolidFaces::addMixed(const Exact& t, std::uint32_t n, Walk& walk, Known& known,
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

SolidFaces::Known SolidFaces::cutMixed(const Exact& t, std::uint32_t n, Walk& walk,
                                       std::vector<Piece>& pieces, int depth) const
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
        const FaceSides other = knownAt(n, (t[m] + middle) / 2, walk).sides;
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

} // namespace mpuvdb
