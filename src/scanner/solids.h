// The solids behind parseSolid(): primitives about the origin, and what combines and moves them.
#pragma once
#include <mpuvdb/scan_sampler.h>

#include <vector>

namespace mpuvdb
{

using SolidPtr = std::shared_ptr<const Solid>;

/// @{ Primitives, exact. Lengths are world units and positive.
SolidPtr makeSphere(double radius);
/// Ring of @a major radius about z, tube of @a minor radius.
SolidPtr makeTorus(double major, double minor);
/// @a size is the full size; edges are rounded with @a radius, from 0 to half the smallest side.
SolidPtr makeBox(const Vec3d& size, double radius);
/// @a radii along the axes.
SolidPtr makeEllipsoid(const Vec3d& radii);
/// All points within @a radius of a segment of @a length along z.
SolidPtr makeCapsule(double radius, double length);
SolidPtr makeCylinder(double radius, double height);
/// Base of @a radius at z = -height/2, apex at z = height/2.
SolidPtr makeCone(double radius, double height);
/// @}

/// A sphere whose radius varies by +-amplitude, @a bumps times around a great circle. The distance
/// is exact within half the smallest radius of curvature, beyond it a lower bound.
/// @param amplitude  at most radius / 8.
SolidPtr makeBlob(double radius, double bumps, double amplitude);

/// @{ Booleans of one or more solids; difference takes all others from the first.
SolidPtr makeUnion(std::vector<SolidPtr> solids);
SolidPtr makeIntersection(std::vector<SolidPtr> solids);
SolidPtr makeDifference(std::vector<SolidPtr> solids);
/// @}

/// The same solid, rotated, scaled by @a scale > 0 and moved, in this order.
SolidPtr makeMoved(SolidPtr solid, const Eigen::Matrix3d& rotation, double scale,
                   const Vec3d& translation);
/// @a count copies of a solid that lies about the +x axis, symmetric to the plane y = 0, turned
/// about z. Exact where the solid is.
SolidPtr makeRing(SolidPtr solid, int count);

} // namespace mpuvdb
