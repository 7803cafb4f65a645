// Estimates of the memory of bands.
#pragma once

namespace mpuvdb
{

/// The area of a surface of @a area offset by @a distance: as of a ball of that area, and about as
/// of any convex solid; kept where solids shrink, as hollow ones gain. In consistent units.
double offsetArea(double area, double distance);

/// The memory of a level set of a surface of @a area (world units squared), bytes; estimated.
double gridBytes(double area, double voxelSize, double halfWidth);

/// The working memory of distances to a surface of @a area (world units squared) in any band, for
/// the surface's patches and the front that starts there, bytes; estimated, to a quarter.
double distanceBytes(double area, double voxelSize);

} // namespace mpuvdb
