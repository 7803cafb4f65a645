// Memory of bands, estimated before it is taken.
#pragma once

namespace mpuvdb
{

/// The area of a solid's surface of @a area that was offset by @a distance: grown as a ball of that
/// area would be, and any convex solid about as much; shrunk ones keep it, for what is hollow
/// gains. All in units of one kind.
double offsetArea(double area, double distance);

/// Memory of a level set of a surface of @a area (world units squared), bytes; estimated.
double gridBytes(double area, double voxelSize, double halfWidth);

/// Memory to find distances to a surface of @a area (world units squared), as wide as may be,
/// bytes; measured, to a quarter: the surface's patches and the front that goes out from them.
double distanceBytes(double area, double voxelSize);

} // namespace mpuvdb
