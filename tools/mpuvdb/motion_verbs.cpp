// mpuvdb twist, bend, taper, transform, resample: a solid deformed, moved, or on other voxels.
#include "level_set_verb.h"

#include <mpuvdb/fields.h>

#include <fmt/format.h>

#include <cmath>
#include <memory>
#include <vector>

namespace mpuvdb::command
{
namespace
{

constexpr double kRadians = M_PI / 180;

/// How far a solid lies off an axis.
struct OffAxis {
    double size = 0, off = 0; ///< of the solid across the axis, and of its middle from it
    std::string where, cure;  ///< for the user

    /// @param box  of the solid, not empty.
    OffAxis(const Box3d& box, const Axis& axis)
    {
        const Vec3d along = axis.direction.normalized(), center = box.center();
        const auto across = [&](const Vec3d& v) { return (v - v.dot(along) * along).norm(); };
        size = (box.sizes() - box.sizes().dot(along.cwiseAbs()) * along.cwiseAbs()).norm();
        off = across(center - axis.origin);
        where = fmt::format("the solid lies {:.4g} off the axis, {:.3g} times its size across", off,
                            off / std::max(size, 1e-300));
        cure = fmt::format("--center {:.6g},{:.6g},{:.6g} puts the axis through it", center[0],
                           center[1], center[2]);
    }
    bool isFar() const
    {
        constexpr double kMaxOffAxis = 5; // sizes of the solid
        return off > kMaxOffAxis * size;
    }
};

/// Checks whether a twist draws out a solid that is far off the axis.
/// @param rate  radians per world unit.
/// @throws UsageError where the solid would become thinner than two voxels.
void requireNearAxis(const Box3d& box, const Axis& axis, double rate, double voxelSize,
                     Session& session)
{
    constexpr double kMinThickness = 2; // voxels
    if (box.isEmpty() || rate == 0) return;
    const OffAxis solid(box, axis);
    const double growth = std::abs(rate) * (solid.off - solid.size / 2);
    if (!(growth > 1)) return;
    if (solid.size / growth < kMinThickness * voxelSize)
        throw UsageError(fmt::format("{}: {:.4g} degrees per unit draw it out to a sheet {:.2g} "
                                     "voxels thick. {}",
                                     solid.where, std::abs(rate) / kRadians,
                                     solid.size / growth / voxelSize, solid.cure));
    if (solid.isFar())
        session.warn(fmt::format("{}: it is drawn out, to about {:.2g} times its surface. {}",
                                 solid.where, growth, solid.cure));
}

/// A verb that deforms a solid.
class WarpVerb : public LevelSetVerb
{
protected:
    LevelSet warped(const LevelSet& solid, const std::shared_ptr<const Warp>& warp,
                    Session& session)
    {
        wayBack() = [warp](std::vector<Vec3d>& places) {
            const std::vector<Vec3d> there = places;
            warp->inverses(there, places);
        };
        return Shape(solid)
            .warped(warp, text().name)
            .evaluate(settingsLike(solid, session), &session.progress());
    }
};

class TwistVerb final : public WarpVerb
{
public:
    VerbText text() const override
    {
        return {"twist", "A solid twisted about an axis",
                "  mpuvdb twist bar.vdb -o screw.vdb --degrees-per-unit 90\n"
                "  mpuvdb twist bar.vdb -o screw.vdb --turn 360 --axis y --center 0,0,0.5\n"
                "      One full turn over the length of the solid, about an upright axis.\n"};
    }

protected:
    void addOwnOptions(CLI::App& app) override
    {
        CLI::Option* const rate =
            app.add_option("--degrees-per-unit", mRate, "Angle per world unit along the axis")
                ->type_name("DEGREES");
        app.add_option("--turn", mTurn, "Instead: angle over the solid's length")
            ->type_name("DEGREES")
            ->excludes(rate);
        addDirection(app, "--axis", mAxis, "Direction of the axis; default: z");
        addTriple(app, "--center", mCenter, "A point on the axis; default: 0,0,0");
    }

    LevelSet make(const std::vector<GridInput>& inputs, Session& session) override
    {
        if (!mRate && !mTurn)
            throw UsageError("there is no angle. Give --degrees-per-unit or --turn");
        const LevelSet& solid = inputs.front().levelSet;
        const Axis axis{mCenter.value_or(Vec3d::Zero()), mAxis.value_or(Vec3d::UnitZ())};
        if (!(axis.direction.norm() > 0)) throw UsageError("--axis 0,0,0: is not a direction");
        const Shape shape(solid);
        double rate = mRate.value_or(0);
        if (mTurn) {
            const double length =
                shape.bounds().isEmpty()
                    ? 0
                    : shape.bounds().sizes().dot(axis.direction.normalized().cwiseAbs());
            rate = length > 0 ? *mTurn / length : 0;
        }
        settings()["degrees_per_unit"] = rate;
        settings()["axis"] = toJson(axis.direction);
        settings()["center"] = toJson(axis.origin);
        session.note(fmt::format("twist       {:.4g} degrees per unit", rate));
        requireNearAxis(shape.bounds(), axis, rate * kRadians, solid.voxelSize(), session);
        return warped(solid, makeTwist(axis, rate * kRadians), session);
    }

private:
    std::optional<double> mRate, mTurn;
    std::optional<Vec3d> mAxis, mCenter;
};

/// The part of an axis that a deformation covers, and what its verbs have in common.
class AlongAxisVerb : public WarpVerb
{
protected:
    void addAxisOptions(CLI::App& app)
    {
        addDirection(app, "--axis", mAxis, "Direction of the axis; default: z");
        addTriple(app, "--center", mCenter, "A point on the axis; default: 0,0,0");
        addLength(app, "--from", mFrom,
                  "Where it begins, along the axis from the center; default: at the solid's end");
        addLength(app, "--to", mTo, "Where it ends; default: at the solid's other end");
    }

    /// Where along an axis a deformation begins and ends, world units.
    struct Part {
        Axis axis;
        double from = 0, to = 0;
    };

    /// The axis, and where it begins and ends. @throws UsageError.
    Part partOf(const GridInput& input, Session& session)
    {
        Part part{
            {mCenter.value_or(Vec3d::Zero()), mAxis.value_or(Vec3d::UnitZ())}, 0, 1}; // of nothing
        if (!(part.axis.direction.norm() > 0)) throw UsageError("--axis 0,0,0: is not a direction");
        const Vec3d along = part.axis.direction.normalized();
        const Box3d box = Shape(input.levelSet).bounds();
        if (!box.isEmpty()) {
            const double middle = along.dot(box.center() - part.axis.origin);
            const double half = along.cwiseAbs().dot(box.sizes()) / 2;
            part.from = middle - half;
            part.to = middle + half;
            const OffAxis solid(box, part.axis);
            if (solid.isFar())
                session.warn(fmt::format("{}: it moves far. {}", solid.where, solid.cure));
        }
        if (mFrom) part.from = input.resolve(*mFrom);
        if (mTo) part.to = input.resolve(*mTo);
        if (!(part.from < part.to))
            throw UsageError(fmt::format("--from {:g} --to {:g}: the first must be smaller",
                                         part.from, part.to));
        settings()["axis"] = toJson(part.axis.direction);
        settings()["center"] = toJson(part.axis.origin);
        settings()["from"] = part.from;
        settings()["to"] = part.to;
        return part;
    }

private:
    std::optional<Vec3d> mAxis, mCenter;
    std::optional<Length> mFrom, mTo;
};

class BendVerb final : public AlongAxisVerb
{
public:
    VerbText text() const override
    {
        return {"bend", "A solid bent about an axis across it",
                "  mpuvdb bend bar.vdb -o arch.vdb --angle 180\n"
                "      The bar along z becomes half a circle that opens towards x.\n"
                "  mpuvdb bend bar.vdb -o hook.vdb --angle 90 --towards=-y --from 0.5\n"
                "      Only what lies above z = 0.5 is bent.\n"};
    }

protected:
    void addOwnOptions(CLI::App& app) override
    {
        app.add_option("--angle", mAngle, "Angle between the two ends of the bent part, up to 360")
            ->type_name("DEGREES")
            ->required();
        addDirection(app, "--towards", mTowards, "Where it is bent to; default: x");
        addAxisOptions(app);
    }

    LevelSet make(const std::vector<GridInput>& inputs, Session& session) override
    {
        if (!(std::abs(mAngle) <= 360))
            throw UsageError(fmt::format("--angle {}: must be from -360 to 360", mAngle));
        const LevelSet& solid = inputs.front().levelSet;
        const Part part = partOf(inputs.front(), session);
        const Vec3d side = mTowards.value_or(Vec3d::UnitX());
        if (side.cross(part.axis.direction).isZero())
            throw UsageError("--towards: is along --axis, and a solid is bent across it. Name "
                             "another direction for one of them");
        const double curvature = mAngle * kRadians / (part.to - part.from);
        settings()["angle"] = mAngle;
        settings()["towards"] = toJson(side);
        if (curvature != 0)
            session.note(fmt::format("bend        the axis becomes a circle of radius {:.4g}",
                                     std::abs(1 / curvature)));
        return warped(solid, makeBend(part.axis, side, curvature, part.from, part.to), session);
    }

private:
    double mAngle = 0;
    std::optional<Vec3d> mTowards;
};

class TaperVerb final : public AlongAxisVerb
{
public:
    VerbText text() const override
    {
        return {"taper", "A solid made narrower, or wider, along an axis",
                "  mpuvdb taper column.vdb -o spire.vdb --end-factor 0.3\n"
                "  mpuvdb taper column.vdb -o vase.vdb --start-factor 0.5 --end-factor 1.5\n"};
    }

protected:
    void addOwnOptions(CLI::App& app) override
    {
        app.add_option("--start-factor", mStart, "Scale across the axis where it begins; above 0")
            ->type_name("FACTOR")
            ->capture_default_str();
        app.add_option("--end-factor", mEnd, "Scale across the axis where it ends; above 0")
            ->type_name("FACTOR")
            ->required();
        addAxisOptions(app);
    }

    LevelSet make(const std::vector<GridInput>& inputs, Session& session) override
    {
        for (const auto& [name, factor] :
             {std::pair{"--start-factor", mStart}, {"--end-factor", mEnd}})
            if (!(factor > 0 && std::isfinite(factor)))
                throw UsageError(fmt::format("{} {}: must be above 0", name, factor));
        const LevelSet& solid = inputs.front().levelSet;
        const Part part = partOf(inputs.front(), session);
        settings()["start_factor"] = mStart;
        settings()["end_factor"] = mEnd;
        return warped(solid, makeTaper(part.axis, part.from, part.to, mStart, mEnd), session);
    }

private:
    double mStart = 1, mEnd = 1;
};

class TransformVerb final : public LevelSetVerb
{
public:
    VerbText text() const override
    {
        return {"transform", "A solid scaled, rotated and moved, in this order",
                "  mpuvdb transform part.vdb -o moved.vdb --translate 0,0,0.5\n"
                "  mpuvdb transform part.vdb -o turned.vdb --rotate 0,0,45 --about 1,1,0\n"
                "  mpuvdb transform part.vdb -o millimeters.vdb --scale 1000 --with-voxels\n"};
    }

protected:
    void addOwnOptions(CLI::App& app) override
    {
        app.add_option_function<std::string>(
               "--scale", [this](const std::string& text) { mScale = parseScale(text); },
               "Factor, or one for each axis")
            ->type_name("S|X,Y,Z");
        addTriple(app, "--rotate", mRotate, "Degrees about the x, y and z axis, in this order");
        addTriple(app, "--translate", mTranslate, "World units");
        addTriple(app, "--about", mAbout,
                  "The fixed point of scaling and rotation; default: 0,0,0");
        app.add_flag("--with-voxels", mWithVoxels,
                     "Scale the voxels too, where the factor is the same for all axes");
    }

    LevelSet make(const std::vector<GridInput>& inputs, Session& session) override
    {
        const LevelSet& solid = inputs.front().levelSet;
        const Vec3d turn = mRotate.value_or(Vec3d::Zero()) * kRadians;
        const Vec3d about = mAbout.value_or(Vec3d::Zero());
        const Eigen::Affine3d motion =
            Eigen::Translation3d(mTranslate.value_or(Vec3d::Zero()) + about) *
            Eigen::AngleAxisd(turn.z(), Vec3d::UnitZ()) *
            Eigen::AngleAxisd(turn.y(), Vec3d::UnitY()) *
            Eigen::AngleAxisd(turn.x(), Vec3d::UnitX()) * Eigen::Scaling(mScale) *
            Eigen::Translation3d(-about);
        settings()["scale"] = toJson(mScale);
        settings()["rotate"] = toJson(mRotate.value_or(Vec3d::Zero()));
        settings()["translate"] = toJson(mTranslate.value_or(Vec3d::Zero()));
        settings()["about"] = toJson(about);
        ShapeSettings shape = settingsLike(solid, session);
        if (mWithVoxels) {
            if (!(mScale.minCoeff() == mScale.maxCoeff()))
                throw UsageError("--with-voxels: voxels have to stay cubes. Scale all axes alike");
            shape.voxelSize *= std::abs(mScale.x());
        } else {
            requireVoxels(solid);
        }
        settings()["voxel_size"] = shape.voxelSize;
        wayBack() = [back = motion.inverse()](std::vector<Vec3d>& places) {
            for (Vec3d& p : places) p = back * p;
        };
        return Shape(solid).moved(motion).evaluate(shape, &session.progress());
    }

private:
    /// @throws UsageError where the scaled solid is smaller than the voxels, which stay.
    void requireVoxels(const LevelSet& solid) const
    {
        constexpr double kLeast = 2; ///< voxels [derived: one of them is inside]
        openvdb::CoordBBox voxels;
        if (!solid.grid().tree().evalActiveVoxelBoundingBox(voxels)) return;
        const openvdb::Vec3d sides = voxels.dim().asVec3d() - openvdb::Vec3d(2 * solid.halfWidth());
        const double longest =
            (mScale.array() * Vec3d(sides[0], sides[1], sides[2]).array()).abs().maxCoeff();
        if (longest < kLeast)
            throw UsageError(fmt::format("--scale: the solid would be {:.2g} voxels long, as "
                                         "voxels stay {:.6g}. Scale them, "
                                         "too (--with-voxels), or resample to smaller ones first",
                                         longest, solid.voxelSize()));
    }

    static Vec3d parseScale(const std::string& text)
    {
        const bool single = text.find(',') == std::string::npos;
        return parseTriple("--scale", single ? text + "," + text + "," + text : text);
    }

    Vec3d mScale = Vec3d::Ones();
    std::optional<Vec3d> mRotate, mTranslate, mAbout;
    bool mWithVoxels = false;
};

class ResampleVerb final : public LevelSetVerb
{
public:
    VerbText text() const override
    {
        return {"resample", "A level set on larger or smaller voxels, or in another band",
                "  mpuvdb resample scan.vdb -o coarse.vdb --voxel-size 0.01\n"
                "  mpuvdb resample scan.vdb -o fine.vdb --voxel-size 0.5vx\n"
                "  mpuvdb resample scan.vdb -o wide.vdb --half-width 10\n"};
    }

protected:
    void addOwnOptions(CLI::App& app) override
    {
        addLength(app, "--voxel-size", mVoxelSize,
                  "Edge of the new voxels; vx are the old ones; default: unchanged");
        app.add_option("--half-width", mHalfWidth,
                       "Voxels of the band on either side; default: unchanged")
            ->type_name("VOXELS");
    }

    LevelSet make(const std::vector<GridInput>& inputs, Session& session) override
    {
        const LevelSet& solid = inputs.front().levelSet;
        const double voxelSize =
            mVoxelSize ? inputs.front().resolve(*mVoxelSize) : solid.voxelSize();
        const double halfWidth = mHalfWidth.value_or(solid.halfWidth());
        settings()["voxel_size"] = voxelSize;
        settings()["half_width"] = halfWidth;
        const Shape shape(solid);
        ShapeSettings wanted = settingsLike(solid, session);
        wanted.voxelSize = voxelSize;
        wanted.halfWidth = halfWidth;
        return shape.evaluate(wanted, &session.progress());
    }

private:
    std::optional<Length> mVoxelSize;
    std::optional<double> mHalfWidth;
};

} // namespace

std::unique_ptr<Verb> makeTwistVerb()
{
    return std::make_unique<TwistVerb>();
}

std::unique_ptr<Verb> makeBendVerb()
{
    return std::make_unique<BendVerb>();
}

std::unique_ptr<Verb> makeTaperVerb()
{
    return std::make_unique<TaperVerb>();
}

std::unique_ptr<Verb> makeTransform()
{
    return std::make_unique<TransformVerb>();
}

std::unique_ptr<Verb> makeResample()
{
    return std::make_unique<ResampleVerb>();
}

} // namespace mpuvdb::command
