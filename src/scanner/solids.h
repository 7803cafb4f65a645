// The solids of parseSolid(): primitives about the origin, Booleans and motions.
#pragma once
#include <mpuvdb/scan_sampler.h>

#include <vector>

namespace mpuvdb
{

using SolidPtr = std::shared_ptr<const Solid>;

/// @{ Primitives, exact. Lengths are world units and positive.
SolidPtr makeSphere(double radius);
/// A ring of @a major radius about z, its tube of @a minor radius.
SolidPtr makeTorus(double major, double minor);
/// A box of full @a size; its edges are rounded with @a radius, from 0 to half the smallest side.
SolidPtr makeBox(const Vec3d& size, double radius);
/// An ellipsoid of @a radii along the axes.
SolidPtr makeEllipsoid(const Vec3d& radii);
/// All points within @a radius of a segment of @a length along z.
SolidPtr makeCapsule(double radius, double length);
SolidPtr makeCylinder(double radius, double height);
/// A cone with a base of @a radius at z = -height/2 and its apex at z = height/2.
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
