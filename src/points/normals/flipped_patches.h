// Whole patches of normals that look the other way than the sheet around them.
#pragma once
#include <mpuvdb/point_cloud.h>

#include <cstdint>
#include <vector>

namespace mpuvdb
{

class Interrupter;
class PointCells;

/// A cloud's normals, some of them turned.
class TurnedNormals
{
public:
    explicit TurnedNormals(const PointCloud& cloud) : mCloud(cloud), mTurned(cloud.size(), 0) {}

    Vec3f normal(std::uint32_t i) const
    {
        return mTurned[i] ? -mCloud.normals[i] : mCloud.normals[i];
    }
    bool turned(std::uint32_t i) const { return mTurned[i] != 0; }
    void turn(std::uint32_t i) { mTurned[i] ^= 1; }

private:
    const PointCloud& mCloud;
    std::vector<char> mTurned;
};

/// Whether a position lies about in the plane of another, as those of its sheet do: other sheets
/// lie above and below a cone about it. @param apart  from the one to the other.
/// @param normal  of the plane. @param noise  standard deviation of the positions.
inline bool liesInPlane(const Vec3f& apart, const Vec3f& normal, float noise)
{
    constexpr float kSlope = 0.3f; // [tuned: clean_points_test]
    // Standard deviations. [derived: 19 of 20 points of a plane lie within]
    constexpr float kNoises = 2;
    const float height = normal.dot(apart), scatter = kNoises * noise;
    return height * height <= kSlope * kSlope * apart.squaredNorm() + scatter * scatter;
}

/// Turn patches of normals that disagree with the sheet around them all along their border. Where
/// that leaves a choice, a connected part is to look outward. @param cells  of all points, some
/// spacings wide. @param noise  standard deviation of the positions. @param many  whether many are
/// known to be flipped: rests are looked for, though nothing looks like a border.
/// @throws Interrupted.
void turnFlippedPatches(const PointCells& cells, double noise, bool many, TurnedNormals& normals,
                        Interrupter& progress);

} // namespace mpuvdb
