// Which faces of a mesh, and which pieces of those that meet others, bound the solid.
#pragma once
#include "oriented_triangles.h"
#include "spatial/triangle_tree.h"
#include "triangle_contacts.h"
#include "winding_number.h"

#include <algorithm>
#include <memory>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// Winding numbers on the two sides of a face.
struct FaceSides {
    double front = 0, back = 0; ///< the side that the normal points to, and the other

    bool bounds(double sign) const { return (sign * front > 0.5) != (sign * back > 0.5); }
    bool facesInward(double sign) const { return sign * front > 0.5; }
    bool isWithin(double sign) const { return sign * front > 0.5 && sign * back > 0.5; }
    /// The smallest change of a side that changes what the face bounds.
    double margin() const { return std::min(std::abs(front - 0.5), std::abs(back - 0.5)); }
};

using Corners = TriangleTree::Corners;

/// Finds the sides of triangles and of their pieces.
class SolidFaces
{
public:
    /// @param mixed  length, world units, down to which triangles are cut that bound the solid only
    /// in part, as those of open meshes may; 0: all of a region of triangles has the same sides.
    SolidFaces(const OrientedTriangles& triangles, const TriangleTree& tree,
               const WindingNumber& winding, const ContactLengths& lengths, double mixed)
        : mTriangles(triangles), mTree(tree), mWinding(winding), mLengths(lengths), mMixed(mixed)
    {
    }

    void find(const std::vector<Contact>& contacts, Interrupter& progress);

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
    std::vector<std::array<Vec3d, 2>> limits() const;

    /// Whether predicate(sides) holds for some triangle, or piece of one.
    template <typename P>
    bool any(const P& predicate) const
    {
        return std::any_of(mSides.begin(), mSides.end(), predicate) ||
               std::any_of(mPieces.begin(), mPieces.end(),
                           [&](const Piece& piece) { return predicate(piece.sides); });
    }

private:
    class Walk;
    /// A piece of a triangle that meets others.
    struct Piece {
        Corners corners;
        std::uint32_t triangle; ///< of the mesh
        FaceSides sides;
        bool isCut = false; ///< from a triangle of which only a part bounds the solid
    };

    Vec3d corner(std::uint32_t n, std::size_t k) const
    {
        return mTriangles.mesh.positions[mTriangles.mesh.triangles[n][k]].cast<double>();
    }
    Vec3d areaVector(std::uint32_t n) const
    {
        return (corner(n, 1) - corner(n, 0)).cross(corner(n, 2) - corner(n, 0)) / 2;
    }

    void findFirst(const std::vector<Contact>& contacts);
    bool isTouched(std::uint32_t n) const { return mFirst[n] != mFirst[n + 1]; }

    /// Triangles that meet no others, and their neighbors that meet none, have the same sides.
    void joinRegions();

    void findRegionSides();

    void cut(const std::vector<Contact>& contacts, Interrupter& progress);

    void addPieces(std::uint32_t n, const std::vector<Contact>& contacts, Walk& walk,
                   std::vector<Piece>& pieces) const;

    using Exact = std::array<Vec3d, 3>;

    /// The edges without a neighbor, as triangles without an area, under a tree.
    void findRims(Interrupter& progress);

    /// The sides of a face, and how far from a place on it they bound the same.
    struct Known {
        std::uint32_t region = kNoTriangle;
        Vec3d place;
        FaceSides sides;
        double radius = 0;

        bool holds(const Exact& t) const
        {
            return std::all_of(t.begin(), t.end(), [&](const Vec3d& p) {
                return (p - place).squaredNorm() <= radius * radius;
            });
        }
    };

    /// The sides at a place of a triangle of an open mesh.
    Known knownAt(std::uint32_t n, const Vec3d& place, Walk& walk) const;

    /// Add a triangle, in pieces if only a part of it bounds the solid. @param known  the last
    /// sides found, which may hold for it.
    void addMixed(const Exact& t, std::uint32_t n, Walk& walk, Known& known,
                  std::vector<Piece>& pieces) const;

    /// Halve a triangle until its sides change less from place to place than would change what it
    /// bounds, or it is small. @return the sides of its middle.
    Known cutMixed(const Exact& t, std::uint32_t n, Walk& walk, std::vector<Piece>& pieces,
                   int depth = 0) const;

    const OrientedTriangles& mTriangles;
    const TriangleTree& mTree;
    const WindingNumber& mWinding;
    const ContactLengths& mLengths;
    double mMixed;
    std::unique_ptr<const TriangleTree> mRims; ///< null without any, or if they do not matter
    std::vector<std::uint32_t> mFirst;         ///< first contact, by triangle
    std::vector<std::uint32_t> mRegion;        ///< region, by triangle that meets no other
    std::vector<std::uint32_t> mLargest;       ///< largest triangle, by region
    std::vector<FaceSides> mSides;             ///< by region
    std::vector<Piece> mPieces;                ///< of the triangles that meet others
};

} // namespace mpuvdb
