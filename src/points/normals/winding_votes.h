// What the winding number says of the orientation of parts, where neighbors cannot know.
#pragma once
#include "orientation.h"
#include "oriented_parts.h"

#include <cstddef>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// How neighbors say that points look, and how they do.
struct NeighborVotes {
    const std::vector<OrientationLink>& links; ///< of the normals before they were turned
    const std::vector<char>& turned;           ///< of each point
};

/// Links of points, of the normals before they were turned, to a node of their part, which looks to
/// the side that most of it does, or is to.
struct WindingVotes {
    std::vector<OrientationLink> links;
    /// Of pieces that are right once others are turned, and were unclear: neighbors know more of
    /// their rims, unless these turn back what is to be turned.
    std::vector<OrientationLink> unclear;
    std::size_t firstPart = 0; ///< the node of the first part
    std::size_t nodes = 0;     ///< one more than the last node; the points are the first ones
    std::size_t against = 0;   ///< points that are to look the other way than they do
    bool done = true;          ///< so few that the others' numbers hardly depend on them
    std::size_t unclosed = 0;  ///< points at which the number is not clearly a half
    double misfit = 0; ///< of the normals as they are; see windingVotes(), world units squared
};

/// The votes of the winding number at the points themselves, between the surface's two sides: it is
/// a half on all solids, however their parts and pieces hang together. Pieces, of what neighbors
/// join and is as far from a half, are turned one by one, as long as the number's squared distance
/// from a half, summed over the surface, falls clearly. Sheets that enclose nothing say nothing.
/// @param areas  of the surface about each point, world units squared.
/// @param noise  standard deviation of the positions, world units.
/// @throws Interrupted.
WindingVotes windingVotes(const OrientedParts& points, const std::vector<float>& areas,
                          double noise, const NeighborVotes& neighbors, Interrupter& progress);

} // namespace mpuvdb
