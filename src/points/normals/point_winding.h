// The winding number of a surface that points lie on, with the price of a tree.
#pragma once
#include "oriented_parts.h"

#include <cstdint>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// The winding number [Barill18] of oriented points: a dipole for each side of the surface in each
/// cell of a grid, in a tree of their sums.
class PointWinding
{
public:
    /// @param areas  of the surface about each of all points, world units squared.
    /// @param noise  standard deviation of the positions, world units.
    PointWinding(const std::vector<Part>& parts, const OrientedParts& points,
                 const std::vector<float>& areas, float noise);

    /// About 1 within a closed part that looks outward, 0 without, a half on it.
    float at(const Vec3f& p) const;

    /// The same at each point, part after part, between the surface's two sides; 0 where hardly any
    /// points are.
    std::vector<float> onPoints(Interrupter& progress) const;

private:
    /// One side of the surface in a cell, or a sum of such.
    struct Dipole {
        Vec3f position = Vec3f::Zero();
        Vec3f areaNormal = Vec3f::Zero(); ///< world units squared
        float softening = 0;              ///< world units squared: of a disc, not of a point
        float points = 0;                 ///< their number

        float at(const Vec3f& p) const;
    };
    struct Node {
        Dipole sum;
        float radius2 = 0; ///< world units squared
        std::uint32_t begin = 0, end = 0;
        std::uint32_t second = 0; ///< child; the first one follows the node; 0: a leaf
    };

    void gather(const Part& part, const OrientedParts& points, const std::vector<float>& areas,
                float noise);
    std::uint32_t build(std::uint32_t begin, std::uint32_t end);
    float sumAt(std::uint32_t node, const Vec3f& p) const;

    std::vector<Dipole> mDipoles;         ///< part after part, in order of space
    std::vector<std::uint32_t> mDipoleOf; ///< of each point, part after part
    std::vector<Node> mNodes;
};

} // namespace mpuvdb
