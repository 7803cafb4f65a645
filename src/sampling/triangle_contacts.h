// Where the triangles of a mesh meet that are no neighbors.
#pragma once
#include "oriented_triangles.h"
#include "spatial/triangle_tree.h"

#include <vector>

namespace mpuvdb
{

/// Lengths, world units, below which places on triangles are one.
struct ContactLengths {
    /// Gaps up to this one are none: the parts of a mesh that share a face rarely share its bits.
    double touch;
    /// Segments up to this one are points.
    double point;
};

/// What a triangle has to do with another that it meets.
struct Contact {
    std::uint32_t triangle, other; ///< of the mesh
    bool cuts;                     ///< along the segment; else the two only touch
    std::array<Vec3d, 2> segment;  ///< relative to the frame; in the triangle's plane
};

/// All contacts, by triangle. The pairs that count share no edge; or they do and fold back onto
/// each other; and if they share a corner, they meet elsewhere too. The same for any number of
/// threads. @throws Interrupted.
std::vector<Contact> findContacts(const OrientedTriangles& triangles, const TriangleTree& tree,
                                  const ContactLengths& lengths, Interrupter& progress);

} // namespace mpuvdb
