// Which of a surface's normals look to the same side, by pairs of neighbors.
#pragma once
#include <mpuvdb/vec.h>

#include <cstdint>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// What two neighbors say about each other's normals: 1 the same side, -1 opposite sides, and 0
/// nothing; reversing one normal reverses the sign.
struct OrientationLink {
    float vote = 0;
    bool unsure = false; ///< across sheets, or by a plane that is none: counts only among others
    std::uint32_t a = 0, b = 0;
};

/// The link of two oriented positions: one's normal, mirrored at the plane between the two, against
/// the other's. 1 on planes, arcs, and across any edge; also for the two sides of a thin wall or a
/// narrow gap, whose normals are opposite. @param noise  standard deviation of the positions.
OrientationLink orientationLink(std::uint32_t a, std::uint32_t b, const Vec3f& apart,
                                const Vec3f& normalA, const Vec3f& normalB, float noise);

/// The link of two positions on two sheets that look opposite ways: a thin wall's sides, or the
/// faces of an acute edge.
OrientationLink linkAcrossSheets(std::uint32_t a, std::uint32_t b, const Vec3f& normalA,
                                 const Vec3f& normalB);

/// Parts that hang together by links, and who in a part must be turned round.
struct Orientation {
    std::vector<std::uint32_t> parts; ///< of each node its part's lowest node
    std::vector<char> turned;         ///< against the part's lowest node
};

/// Turn nodes so that links agree. Sure links join nodes one by one, the surest first; what then
/// are patches is joined by the sum of all links between two, so that a few wrong ones do not turn
/// a whole patch [a minimum spanning tree (Hoppe92) would hang on a single one].
/// @param known  links that join before all others, whatever these say.
Orientation solveOrientation(std::size_t nodes, const std::vector<OrientationLink>& links,
                             Interrupter& progress, const std::vector<OrientationLink>& known = {});

/// Of each node the lowest of its piece: nodes of a group, which links join that agree with an
/// orientation, sure ones one by one, and others where more of them agree than do not.
/// @param turned, groups  of each node; links of other nodes are passed over.
std::vector<std::uint32_t> agreeingPieces(const std::vector<OrientationLink>& links,
                                          const std::vector<char>& turned,
                                          const std::vector<char>& groups, Interrupter& progress);

} // namespace mpuvdb
