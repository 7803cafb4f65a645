// Contacts between triangles of a mesh that are not neighbors.
#pragma once
#include "oriented_triangles.h"
#include "spatial/triangle_tree.h"

#include <vector>

namespace mpuvdb
{

/// Length tolerances of contacts, world units.
struct ContactLengths {
    /// Width up to which gaps are contacts: parts that share a face rarely share its bits.
    double touch;
    /// Length up to which segments are points.
    double point;
};

/// The contact of a triangle with another.
struct Contact {
    std::uint32_t triangle, other; ///< of the mesh
    bool cuts;                     ///< along the segment; else the two only touch
    std::array<Vec3d, 2> segment;  ///< relative to the frame; in the triangle's plane
};

/// All contacts, by triangle, of pairs that share no edge unless they fold back onto each other,
/// and that meet elsewhere if they share a corner. The same for any number of threads.
/// @throws Interrupted.
std::vector<Contact> findContacts(const OrientedTriangles& triangles, const TriangleTree& tree,
                                  const ContactLengths& lengths, Interrupter& progress);

} // namespace mpuvdb
