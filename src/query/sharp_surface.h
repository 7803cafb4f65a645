// The surface of a level set as triangles that keep its creases, for the nearest places and rays.
#pragma once
#include "signed_triangles.h"
#include <mpuvdb/field.h>
#include <mpuvdb/fields.h>
#include <mpuvdb/level_set.h>

#include <optional>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// A place on the surface that is the nearest one, or that a ray meets.
struct SurfaceFoot {
    Vec3d place;     ///< world units
    Vec3d direction; ///< unit; the distance's gradient at the place that was asked for
    double distance; ///< signed, world units
};

/// Triangles of a level set's surface and a tree of them. Between vertices where its values are
/// smooth the triangles stand for the zero set of cubic interpolation. All members are safe to call
/// from many threads.
class SharpSurface
{
public:
    /// @param levelSet  is not empty. @param field  see extractMesh(), or null.
    /// @throws LimitError, Interrupted.
    SharpSurface(const LevelSet& levelSet, const Field* field, Interrupter& progress);

    /// Memory of the triangles of @a levelSet and of their tree, bytes. @throws Interrupted.
    static std::uint64_t bytesFor(const LevelSet& levelSet, const Interrupter& progress);

    const SignedTriangles& triangles() const { return mTriangles; }
    /// The nearest place to @a p, which is finite. @param near  that of the triangles.
    /// @param inside  whether @a p is, where that is known.
    SurfaceFoot nearest(const Vec3d& p, std::optional<bool> inside,
                        const SignedTriangles::Near& near) const;

    /// The first place that a ray meets: origin + t * direction. @return t, infinite for none.
    double firstHit(const Vec3d& origin, const Vec3d& direction, Vec3d& normal) const;

private:
    bool isSmooth(std::size_t slot) const;
    std::optional<SurfaceFoot> refined(const Vec3d& p, const Vec3d& place) const;

    double mVoxelSize;
    FieldPtr mField; ///< cubic interpolation of the level set
    SignedTriangles mTriangles;
    std::vector<bool> mSmooth; ///< by vertex
};

} // namespace mpuvdb
