// Triangles with two sides: the nearest place, and the side on which it is seen.
#pragma once
#include "cell_triangles.h"
#include "spatial/triangle_tree.h"

#include <cmath>

namespace mpuvdb
{

class Interrupter;

/// A mesh and a tree of it. All members are safe to call from many threads.
class SignedTriangles
{
public:
    /// @param mesh  has triangles. @param same  world units: distances that are equal but for
    /// roundings.
    SignedTriangles(Mesh mesh, double same, Interrupter& progress);

    const Mesh& mesh() const { return mMesh; }
    const TriangleTree& tree() const { return mTree; }

    struct Near {
        Vec3d place;     ///< world units
        double distance; ///< to it, from 0 on
        std::size_t slot;
    };
    /// What is known of a place nearby: some place on the triangles is that far from it.
    struct Hint {
        Vec3d place = Vec3d::Zero();
        double distance = HUGE_VAL;
    };
    /// The place nearest to @a p, world units. It does not depend on @a hint, which saves time, and
    /// becomes that of @a p.
    Near nearest(const Vec3d& p, Hint& hint) const;
    /// The same by the triangles gathered about @a p.
    Near nearest(const Vec3d& p, CellTriangles& gathered) const;
    /// Whether @a p, to which @a near is nearest, is behind the triangles.
    bool isBehind(const Vec3d& p, const Near& near) const;
    /// Unit; zero for a triangle without area.
    Vec3d normal(std::size_t slot) const;

private:
    std::array<Vec3d, 3> cornersOf(std::size_t slot) const;
    Near nearOn(std::size_t slot, const Vec3d& from, double squaredDistance) const;

    Mesh mMesh;
    double mSame;
    TriangleTree mTree;
};

} // namespace mpuvdb
