// mpuvdb union, intersection, difference, xor, clip: solids as one, or parts of one.
#include "carried_grids.h"

#include <mpuvdb/attribute_grids.h>
#include <mpuvdb/carried_attributes.h>
#include <mpuvdb/sampling.h>
#include <mpuvdb/scan_sampler.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <optional>
#include <utility>

namespace mpuvdb::command
{
namespace
{

/// Solids in, their attributes carried to the result; the first file's other grids go along.
class SolidsVerb : public LevelSetVerb
{
protected:
    Count inputCount() const override { return {1, 0}; }

    openvdb::GridCPtrVec gridsBeside(const LevelSet& made, const std::vector<GridInput>& inputs,
                                     Session& session) const override
    {
        std::vector<Operand> operands;
        operands.reserve(inputs.size());
        for (const GridInput& input : inputs) operands.push_back({input.levelSet, input.others});
        const auto attributes = attributesOfOperands(operands);
        for (std::size_t n = 0; n < inputs.size(); ++n)
            warnOfLacks(inputs[n], *attributesOfOperands({operands[n]}), *attributes, session);
        openvdb::GridCPtrVec grids;
        if (attributes->channels() > 0)
            for (const auto& grid : sampleAttributes(made, *attributes, &session.progress()))
                grids.push_back(grid);
        const auto isCarried = [&](const openvdb::GridBase::ConstPtr& other) {
            return std::any_of(grids.begin(), grids.end(), [&](const auto& grid) {
                return grid->getName() == other->getName();
            });
        };
        const auto isOperand = [&](const openvdb::GridBase::ConstPtr& other) {
            return std::any_of(inputs.begin(), inputs.end(), [&](const GridInput& input) {
                return input.file == inputs.front().file &&
                       input.levelSet.grid().getName() == other->getName();
            });
        };
        for (const openvdb::GridBase::ConstPtr& other : inputs.front().others)
            if (!isCarried(other) && !isOperand(other)) grids.push_back(other);
        return grids;
    }

private:
    /// Tell of the attributes of the result that an input does not have.
    static void warnOfLacks(const GridInput& input, const SurfaceAttributes& own,
                            const SurfaceAttributes& all, Session& session)
    {
        const auto warn = [&](const std::string& attribute, const char* value) {
            session.warn(fmt::format("{}: '{}' has no {}, which other inputs have: what is left of "
                                     "its surface gets {}",
                                     input.file, input.levelSet.grid().getName(), attribute,
                                     value));
        };
        if (all.hasColors() && !own.hasColors()) warn("colors", "white");
        const std::vector<std::string>& names = own.scalarNames();
        for (const std::string& name : all.scalarNames())
            if (std::find(names.begin(), names.end(), name) == names.end())
                warn("'" + name + "'", "0");
    }
};

class BooleanVerb final : public SolidsVerb
{
public:
    BooleanVerb(Boolean kind, const VerbText& text) : mKind(kind), mText(text) {}

    VerbText text() const override { return mText; }

protected:
    void addOwnOptions(CLI::App& app) override
    {
        addLength(app, "--blend", mBlend,
                  "Fillet the creases that come about, as a ball of this radius would that\n"
                  "rolls along them; farther away nothing changes. Default: sharp");
        addSharedVoxelSize(app, mVoxelSize);
    }

    LevelSet make(const std::vector<GridInput>& inputs, Session& session) override
    {
        double radius = 0;
        if (mBlend) {
            radius = inputs.front().resolve(*mBlend);
            if (!(radius >= 0))
                throw UsageError(fmt::format("--blend {}: must be from 0 on", mBlend->text()));
        }
        std::vector<Shape> shapes;
        shapes.reserve(inputs.size());
        for (const GridInput& input : inputs) shapes.emplace_back(input.levelSet);
        const std::vector<LevelSet> solids = onOneLattice(
            inputs, Shape::combine(mKind, shapes, radius), mVoxelSize, settings(), session);
        settings()["blend"] = radius;
        settings()["inputs"] = inputs.size();
        if (mBlend) session.note("blend       " + lengthText(radius, solids.front().voxelSize()));
        return Shape::combine(mKind, shapesOf(solids), radius)
            .evaluate(settingsLike(solids, session), &session.progress());
    }

private:
    Boolean mKind;
    VerbText mText;
    std::optional<Length> mBlend, mVoxelSize;
};

class ExclusiveOrVerb final : public SolidsVerb
{
public:
    VerbText text() const override
    {
        return {
            "xor", "What lies in one of the solids, but not in both",
            "  mpuvdb xor before.vdb after.vdb -o changed.vdb\n"
            "      What was added and what was taken away. Where the surfaces cross, four parts\n"
            "      meet in a line, beside which distances are known to half a voxel.\n"};
    }

protected:
    void addOwnOptions(CLI::App& app) override { addSharedVoxelSize(app, mVoxelSize); }

    LevelSet make(const std::vector<GridInput>& inputs, Session& session) override
    {
        std::vector<Shape> shapes;
        shapes.reserve(inputs.size());
        for (const GridInput& input : inputs) shapes.emplace_back(input.levelSet);
        const std::vector<LevelSet> solids =
            onOneLattice(inputs, exclusiveOr(shapes), mVoxelSize, settings(), session);
        settings()["inputs"] = inputs.size();
        return exclusiveOr(shapesOf(solids))
            .evaluate(settingsLike(solids, session), &session.progress());
    }

private:
    /// What lies in an odd number of @a shapes.
    static Shape exclusiveOr(const std::vector<Shape>& shapes)
    {
        Shape result = shapes.front();
        for (std::size_t n = 1; n < shapes.size(); ++n)
            result = (result - shapes[n]) | (shapes[n] - result);
        return result;
    }

    std::optional<Length> mVoxelSize;
};

class ClipVerb final : public LevelSetVerb
{
public:
    VerbText text() const override
    {
        return {"clip", "The part of a solid in a box or in another solid, closed and sharp",
                "  mpuvdb clip scan.vdb -o part.vdb --box 0 0 0 1 1 0.5\n"
                "  mpuvdb clip scan.vdb -o top.vdb --box open open 0.2 open open open\n"
                "      All above z = 0.2: a plane cut.\n"
                "  mpuvdb clip scan.vdb -o rest.vdb --mask tool.vdb --outside\n"
                "  mpuvdb clip scan.vdb -o half.vdb --box open open 0 open open open --open\n"
                "  mpuvdb mesh half.vdb -o half.ply --holes open\n"
                "      Without a face at the cut.\n"};
    }

protected:
    void addOwnOptions(CLI::App& app) override
    {
        CLI::Option* const box =
            app.add_option("--box", mBox,
                           "Keep what lies in this box (X0 Y0 Z0 X1 Y1 Z1); a side may be open")
                ->type_name("LENGTH")
                ->expected(6);
        app.add_option("--mask", mMask,
                       "Instead: keep what lies in this solid; FILE.vdb:NAME names its grid. The\n"
                       "voxels stay those of the input")
            ->type_name("MASK.vdb")
            ->excludes(box);
        app.add_flag("--outside", mOutside, "Keep what lies outside instead");
        app.add_flag(
            "--open", mOpen,
            "Say in a grid 'coverage' what of the surface is the cut, so that meshes leave it\n"
            "out (mpuvdb mesh --holes open)");
    }

    std::vector<std::string> otherInputs() const override
    {
        return mMask.empty() ? std::vector<std::string>()
                             : std::vector<std::string>{gridPlace(mMask, {}).file};
    }

    LevelSet make(const std::vector<GridInput>& inputs, Session& session) override
    {
        if (mBox.empty() && mMask.empty())
            throw UsageError("there is nothing to clip by. Give --box or --mask");
        const LevelSet& solid = inputs.front().levelSet;
        const Shape tool = mMask.empty()
                               ? boxShape(cornersOf(inputs.front()), solid)
                               : Shape(readGridInput(mMask, {}, session).levelSet, "mask");
        session.progress().beginStage("clip");
        settings()["outside"] = mOutside;
        if (mOpen) mTool = tool.evaluate(settingsLike(solid, session), &session.progress());
        const Shape clipped = mOutside ? Shape(solid) - tool : Shape(solid) & tool;
        return clipped.evaluate(settingsLike(solid, session), &session.progress());
    }

    openvdb::GridCPtrVec gridsBeside(const LevelSet& made, const std::vector<GridInput>& inputs,
                                     Session& session) const override
    {
        if (!mTool) return LevelSetVerb::gridsBeside(made, inputs, session);
        openvdb::FloatGrid::ConstPtr own; // the solid's coverage
        GridInput solid = inputs.front();
        const auto isCoverage = [&](const openvdb::GridBase::ConstPtr& other) {
            const auto floats = openvdb::gridConstPtrCast<openvdb::FloatGrid>(other);
            if (!floats || other->getName() != kCoverageName) return false;
            own = floats;
            return true;
        };
        solid.others.erase(std::remove_if(solid.others.begin(), solid.others.end(), isCoverage),
                           solid.others.end());
        openvdb::GridCPtrVec grids = carriedGrids(made, solid, {}, session);
        grids.push_back(
            sampleCoverage(made, *coverageOfCut(inputs.front().levelSet, *mTool, std::move(own)),
                           &session.progress()));
        return grids;
    }

private:
    /// The box as the user gave it, which may be infinite. @throws UsageError.
    Box3d cornersOf(const GridInput& input)
    {
        std::array<double, 6> sides{};
        for (std::size_t n = 0; n < sides.size(); ++n)
            sides[n] = mBox[n] != "open" ? input.resolve(Length::parse(mBox[n]))
                       : n < 3           ? -HUGE_VAL
                                         : HUGE_VAL;
        const Box3d box(Vec3d(sides[0], sides[1], sides[2]), Vec3d(sides[3], sides[4], sides[5]));
        for (int axis = 0; axis < 3; ++axis)
            if (!(box.min()[axis] < box.max()[axis]))
                throw UsageError(fmt::format("--box: along {} it goes from {} to {}. Write the "
                                             "smaller corner first: X0 Y0 Z0 X1 Y1 Z1",
                                             "xyz"[axis], box.min()[axis], box.max()[axis]));
        settings()["box_min"] = toJson(Vec3d(box.min()));
        settings()["box_max"] = toJson(Vec3d(box.max()));
        return box;
    }

    /// A finite box with the same part of @a solid: sides end beyond its band.
    static Shape boxShape(Box3d box, const LevelSet& solid)
    {
        const double h = solid.voxelSize(), margin = (solid.halfWidth() + 2) * h;
        const Box3d around = Shape(solid).bounds();
        for (int axis = 0; axis < 3 && !around.isEmpty(); ++axis) {
            const double low = around.min()[axis] - margin, high = around.max()[axis] + margin;
            double &from = box.min()[axis], &to = box.max()[axis];
            if (to <= low || from >= high) { // beside the solid: a slab there has none of it
                (to <= low ? from : to) = to <= low ? to - h : from + h;
                continue;
            }
            from = std::max(from, low);
            to = std::min(to, high);
        }
        if (around.isEmpty()) box = Box3d(Vec3d::Constant(-h), Vec3d::Constant(h));
        const Vec3d size = box.sizes();
        FieldPtr centered =
            makeSolidField(parseSolid(fmt::format("box({},{},{})", size.x(), size.y(), size.z())));
        return Shape(makeMovedField(std::move(centered),
                                    Eigen::Affine3d(Eigen::Translation3d(box.center()))),
                     "box");
    }

    std::vector<std::string> mBox;
    std::string mMask;
    bool mOutside = false, mOpen = false;
    std::optional<LevelSet> mTool; ///< the box or the mask, for an open cut
};

} // namespace

std::unique_ptr<Verb> makeClip()
{
    return std::make_unique<ClipVerb>();
}

std::unique_ptr<Verb> makeExclusiveOr()
{
    return std::make_unique<ExclusiveOrVerb>();
}

std::unique_ptr<Verb> makeUnion()
{
    return std::make_unique<BooleanVerb>(
        Boolean::Union,
        VerbText{"union", "Solids joined, with their creases sharp or filleted",
                 "  mpuvdb union body.vdb arm.vdb -o both.vdb\n"
                 "  mpuvdb union body.vdb arm.vdb leg.vdb -o statue.vdb --blend 0.02\n"
                 "      The creases between them become fillets of radius 0.02.\n"
                 "  mpuvdb union fine.vdb coarse.vdb -o both.vdb --voxel-size 0.01\n"});
}

std::unique_ptr<Verb> makeIntersection()
{
    return std::make_unique<BooleanVerb>(
        Boolean::Intersection, VerbText{"intersection", "What solids have in common",
                                        "  mpuvdb intersection part.vdb mold.vdb -o inner.vdb\n"});
}

std::unique_ptr<Verb> makeDifference()
{
    return std::make_unique<BooleanVerb>(
        Boolean::Difference,
        VerbText{"difference", "The first solid without the others",
                 "  mpuvdb difference block.vdb drill.vdb -o drilled.vdb\n"
                 "  mpuvdb difference thick.vdb scan.vdb -o shell.vdb --blend 2vx\n"});
}

} // namespace mpuvdb::command
