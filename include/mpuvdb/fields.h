// Fields made from formulas and from other fields: solids, functions, motions, warps.
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

/// The distance of a solid.
FieldPtr makeSolidField(std::shared_ptr<const Solid> solid);

/// The points p with normal . (p - point) <= 0: unbounded. @param normal  of any length but zero.
/// @throws UsageError for a normal that is zero, or what is not finite.
FieldPtr makeHalfSpace(const Vec3d& point, const Vec3d& normal);

/// A wall of @a thickness (world units) along the gyroid of @a period (world units per repetition):
/// unbounded, and no distance.
/// @throws UsageError unless both are above 0 and walls leave space between them.
FieldPtr makeGyroid(double period, double thickness);

/// The solid where @a function is negative, clipped to @a bounds. The function is called some
/// voxels beyond them too, from several threads at once.
/// @param steepness  largest norm of the function's gradient, > 0: with too small a number parts
/// may be missed; with much too large a one edges at the bounds are less exact.
/// @throws UsageError without a function, for bounds that are empty or infinite, or a steepness
/// out of range; InputError from evaluation, where the function is not finite.
FieldPtr makeFunctionField(std::function<double(const Vec3d&)> function, const Box3d& bounds,
                           double steepness);

/// A function of many points at once: for functions that are slow to call, such as a script's.
using PointsFunction =
    std::function<void(const std::vector<Vec3d>& points, std::vector<double>& values)>;
/// makeFunctionField() with a function of many points.
FieldPtr makeFunctionField(PointsFunction function, const Box3d& bounds, double steepness);

/// @a field under an affine @a motion: a distance if the scale is uniform and @a field is one.
/// @throws UsageError if @a motion has no inverse or is not finite.
FieldPtr makeMovedField(FieldPtr field, const Eigen::Affine3d& motion);

/// The part of @a field inside @a box: a distance but outside of the edges that clipping makes.
/// @throws UsageError if @a box is empty or infinite.
FieldPtr makeClippedField(FieldPtr field, const Box3d& box);

/// A deformation of space, given by its inverse.
class Warp
{
public:
    virtual ~Warp() = default;
    /// The place that is moved to @a p.
    virtual Vec3d inverse(const Vec3d& p) const = 0;
    /// A box around what @a box is moved to.
    virtual Box3d image(const Box3d& box) const = 0;
    /// The largest factor by which the inverse stretches a length, anywhere in @a image.
    virtual double stretch(const Box3d& image) const = 0;
    /// The warp by @a first and then by this as one warp, where they are of a kind that allows it;
    /// else null.
    virtual std::shared_ptr<const Warp> after(const Warp& /*first*/) const { return nullptr; }
    /// The inverse of many points.
    virtual void inverses(const std::vector<Vec3d>& points, std::vector<Vec3d>& from) const;
    /// Whether inverses() costs much less than inverse() of one point after the other.
    virtual bool inBatches() const { return false; }
};

/// An axis in space. @param direction  not zero.
struct Axis {
    Vec3d origin = Vec3d::Zero();
    Vec3d direction = Vec3d::UnitZ();
};

/// A twist about @a axis by @a angle, radians per world unit along it.
/// @throws UsageError, as the functions below, for what is out of range or not finite.
std::shared_ptr<const Warp> makeTwist(const Axis& axis, double angle);
/// A bend of what lies along @a axis into a circle towards @a side (not along the axis). @a
/// curvature is 1 / radius, per world unit; the part between @a from and @a to (world units along
/// the axis) is bent, at most once around, and what lies beyond goes on straight.
std::shared_ptr<const Warp> makeBend(const Axis& axis, const Vec3d& side, double curvature,
                                     double from, double to);
/// A scale across @a axis by a factor that goes from @a factorFrom at @a from to @a factorTo at
/// @a to (world units along the axis), and stays beyond. Factors are positive.
std::shared_ptr<const Warp> makeTaper(const Axis& axis, double from, double to, double factorFrom,
                                      double factorTo);
/// A user's warp. @param inverse, image  as in Warp. @param stretch  as in Warp, everywhere, > 0.
std::shared_ptr<const Warp> makeWarp(std::function<Vec3d(const Vec3d&)> inverse,
                                     std::function<Box3d(const Box3d&)> image, double stretch);

/// An inverse of many points at once.
using PlacesFunction =
    std::function<void(const std::vector<Vec3d>& points, std::vector<Vec3d>& from)>;
/// makeWarp() with an inverse of many points.
std::shared_ptr<const Warp> makeWarp(PlacesFunction inverse,
                                     std::function<Box3d(const Box3d&)> image, double stretch);

/// @a field deformed by @a warp: no distance.
/// @throws UsageError if @a field is unbounded, or the stretch infinite where it is.
FieldPtr makeWarpedField(FieldPtr field, std::shared_ptr<const Warp> warp);

} // namespace mpuvdb
