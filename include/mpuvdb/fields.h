// Fields that are made from formulas and from other fields: solids, functions, motions, warps.
#pragma once
#include <mpuvdb/field.h>

#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace mpuvdb
{

class Solid;

using FieldPtr = std::shared_ptr<const Field>;

/// A solid with its exact distance.
FieldPtr makeSolidField(std::shared_ptr<const Solid> solid);

/// The points p with normal . (p - point) <= 0: unbounded. @param normal  not zero.
FieldPtr makeHalfSpace(const Vec3d& point, const Vec3d& normal);

/// The wall of @a thickness along the gyroid of @a period (world units per repetition): unbounded,
/// and no distance.
FieldPtr makeGyroid(double period, double thickness);

/// Wherever @a function is negative within @a bounds: what would leave them is cut off at their
/// faces. It is called some voxels beyond them too, and may be from several threads at once.
/// @param steepness  the largest length of its gradient, > 0: if it is less, parts may be missed;
/// if it is much more, the cut's edges and what touches the bounds are less exact.
FieldPtr makeFunctionField(std::function<double(const Vec3d&)> function, const Box3d& bounds,
                           double steepness);

/// A value for each of many points: for functions that cost much to call, such as a script's.
using PointsFunction =
    std::function<void(const std::vector<Vec3d>& points, std::vector<double>& values)>;
FieldPtr makeFunctionField(PointsFunction function, const Box3d& bounds, double steepness);

/// @a field turned, scaled and moved: a distance if the scale is uniform and @a field is one.
/// @throws UsageError if @a motion has no inverse or is not finite.
FieldPtr makeMovedField(FieldPtr field, const Eigen::Affine3d& motion);

/// The part of @a field inside @a box: a distance only as far as the smaller of the two tells it.
FieldPtr makeClippedField(FieldPtr field, const Box3d& box);

/// A deformation of space, given by its inverse.
class Warp
{
public:
    virtual ~Warp() = default;
    /// Where what comes to lie at @a p comes from.
    virtual Vec3d inverse(const Vec3d& p) const = 0;
    /// Where @a p goes, or a box around where @a box goes.
    virtual Box3d image(const Box3d& box) const = 0;
    /// The largest factor by which the inverse stretches a length, anywhere in @a image.
    virtual double stretch(const Box3d& image) const = 0;
    /// inverse() of many points.
    virtual void inverses(const std::vector<Vec3d>& points, std::vector<Vec3d>& from) const;
    /// Whether inverses() costs much less than inverse() of one point after the other.
    virtual bool inBatches() const { return false; }
};

/// An axis in space. @param direction  not zero.
struct Axis {
    Vec3d origin = Vec3d::Zero();
    Vec3d direction = Vec3d::UnitZ();
};

/// Turn about @a axis by @a angle (radians) per world unit along it.
std::shared_ptr<const Warp> makeTwist(const Axis& axis, double angle);
/// Bend what lies along @a axis into a circle towards @a side (not along the axis): @a curvature is
/// 1 / radius, per world unit; only the part between @a from and @a to along the axis is bent, what
/// lies beyond goes on straight.
std::shared_ptr<const Warp> makeBend(const Axis& axis, const Vec3d& side, double curvature,
                                     double from, double to);
/// Scale across @a axis by a factor that goes from @a factorFrom at @a from to @a factorTo at @a to
/// along it, and stays beyond. Factors are positive.
std::shared_ptr<const Warp> makeTaper(const Axis& axis, double from, double to, double factorFrom,
                                      double factorTo);
/// A user's own. @param stretch  see Warp, everywhere. @param image  see Warp.
std::shared_ptr<const Warp> makeWarp(std::function<Vec3d(const Vec3d&)> inverse,
                                     std::function<Box3d(const Box3d&)> image, double stretch);

/// The same for a function of many points at once.
using PlacesFunction =
    std::function<void(const std::vector<Vec3d>& points, std::vector<Vec3d>& from)>;
std::shared_ptr<const Warp> makeWarp(PlacesFunction inverse,
                                     std::function<Box3d(const Box3d&)> image, double stretch);

/// @a field deformed by @a warp: no distance.
FieldPtr makeWarpedField(FieldPtr field, std::shared_ptr<const Warp> warp);

} // namespace mpuvdb
