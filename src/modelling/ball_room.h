// Where the center of a ball can be that rolls along two solids, and what that leaves filled.
#pragma once
#include "ball_path.h"
#include "rolled_surface.h"

#include <optional>
#include <vector>

namespace mpuvdb
{

/// The room for a ball about the union of two solids. Where the ball does not reach, the union is
/// filled; but what it does not reach about one solid alone, in its hollows, stays as it is.
/// Lengths are voxels. All members are safe to call from many threads.
class BallRoom
{
public:
    /// @param halfWidth  of the result's band. @param voxelSize  world units.
    /// @throws LimitError, Interrupted.
    BallRoom(const BallSolid& a, const BallSolid& b, double voxelSize, float radius,
             float halfWidth, Interrupter& progress);
    ~BallRoom();

    /// The leaves with surface that the ball does not reach because of the other solid, in order.
    const std::vector<openvdb::Coord>& unreached() const { return mUnreached; }
    /// Whether the ball does not fit into a hollow of one solid where the other's surface is.
    bool isTooNarrow() const;

    struct Fill {
        float value;
        /// Whether it is the distance to the union with its fillets: not where these run into
        /// hollows of one solid, or meet.
        bool isDistance;
    };
    /// The new value of a voxel, if it has one. @param sharp  value of the union.
    std::optional<Fill> fillAt(const openvdb::Coord& voxel, float sharp) const;
    /// Whether no voxel of a leaf has a new value, or all have one beyond the band.
    enum class Whole { Neither, Kept, Full };
    Whole wholeLeaf(const openvdb::Coord& origin) const;
    /// The radius of the ball that fits between two surfaces that are opposed at a voxel; 0 where
    /// they are not.
    float roomBetween(const openvdb::Coord& voxel) const;

private:
    struct Feet;

    Vec3f placeOf(const openvdb::Coord& voxel) const;
    Feet feetOf(const openvdb::Coord& voxel) const;
    BallContact contactFor(const openvdb::Coord& voxel) const;
    float hollowAt(const openvdb::Coord& voxel) const;
    bool isBehindFace(const Vec3f& p, float distance) const;
    float faceDistance(const Vec3f& p, float most) const;

    float mRadius, mHalfWidth;
    float mFarthest; ///< distance to a center that counts as none
    openvdb::Coord mFrame;
    std::unique_ptr<RolledSurface> mA, mB; ///< null: nothing is near the other
    std::unique_ptr<BallPath> mPath;
    Places mFaces; ///< centers of balls that touch one solid, in the tree's order
    std::unique_ptr<PlaceTree> mFaceTree;
    std::vector<openvdb::Coord> mUnreached;
};

} // namespace mpuvdb
