// The surface of a solid along which a ball rolls, beside another solid.
#pragma once
#include "distance/patch_tree.h"

#include <cstdint>
#include <memory>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// A solid by its level set; @a side is -1 for its complement, else 1.
struct BallSolid {
    const openvdb::FloatTree& tree;
    float side;
};

/// What a ball meets that touches a surface.
enum class BallContact : std::uint8_t {
    Unknown, ///< far from the other solid
    Free,    ///< nothing else
    Other,   ///< the other solid
    Own      ///< another part of the same surface: it is over a hollow
};

/// Lengths are voxels, places count from the frame. The const members are safe to call from many
/// threads.
class RolledSurface
{
public:
    using Leaf = SurfacePatches::Leaf;

    /// @param solid  has to outlive this. @param near  the leaves whose surface a ball may touch,
    /// in order; @param beside  those that such a ball may meet, which hold all of @a near.
    RolledSurface(const BallSolid& solid, double voxelSize, float radius,
                  std::vector<openvdb::Coord> near, std::vector<const Leaf*> beside,
                  const openvdb::Coord& frame, Interrupter& progress);

    /// Find what the balls meet that touch this surface. @param seeds  receives centers near those
    /// of balls that touch both. @param unreached  receives the leaves with a place less than
    /// @a halfWidth in the other solid that the ball does not touch because of that solid.
    void roll(const RolledSurface& other, float halfWidth, std::vector<Vec3f>& seeds,
              std::vector<openvdb::Coord>& unreached, Interrupter& progress);

    const PatchTree& tree() const { return *mTree; }
    /// What the ball meets that touches a patch; at an edge or a corner the ball of all those that
    /// meets least.
    BallContact contactAt(std::uint32_t patch) const { return mContacts[patch]; }
    /// What the ball meets that touches the surface at the nearest place to @a p. @param distance
    /// to it, negative in the solid.
    BallContact contactAt(const PatchTree::Near& near, const Vec3f& p, float distance,
                          const RolledSurface& other) const;
    /// Where the ball touches nothing but this: centers, and normals of the surface.
    const Places& free() const { return mFree; }
    /// Whether the ball does not fit into a hollow beside the other's surface.
    bool isTooNarrow() const { return mIsTooNarrow; }
    bool hasHollows() const { return mHasHollows; }
    /// The value of a voxel, negative in the solid.
    float valueAt(const openvdb::Coord& voxel) const
    {
        return mScale * mSolid.tree.getValue(voxel);
    }
    /// Whether @a p lies in the solid.
    bool holds(const Vec3f& p) const;
    /// The distance from @a p to the nearest center of a ball beside this solid alone, if that is
    /// less than @a most; else @a most.
    float roomDistance(const Vec3f& p, float most) const;

private:
    /// A ball that touches a patch; the normal leads to its center.
    struct Ball {
        std::uint32_t patch;
        Vec3f center, normal;
        float spacing; ///< of centers of balls at neighboring patches
        BallContact contact;
        float gap; ///< to the other solid; below 0 where the ball would meet it
    };

    void addBalls(std::uint32_t patch, std::vector<Ball>& balls) const;
    void addBallsAtVertex(std::uint32_t vertex, std::vector<Ball>& balls) const;
    void addBall(std::uint32_t patch, const Vec3f& normal, float spacing,
                 std::vector<Ball>& balls) const;
    Vec3f outwards(const SurfaceFacet& facet, std::size_t half) const;
    BallContact meet(const RolledSurface& other, const Ball& ball, float& gap) const;

    BallSolid mSolid;
    float mScale, mRadius;
    std::vector<openvdb::Coord> mNear;
    SurfacePatches mPatches;
    std::unique_ptr<PatchTree> mTree;
    std::vector<BallContact> mContacts; ///< by patch
    Places mFree, mRoom; ///< mRoom: also of balls that meet the other solid; in its tree's order
    std::unique_ptr<PlaceTree> mRoomTree;
    bool mIsTooNarrow = false, mHasHollows = false;
};

} // namespace mpuvdb
