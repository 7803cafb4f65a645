// mpuvdb offset, shell, smooth: the surface moved along its normals, as a wall, smoothed.
#include "level_set_verb.h"

#include <mpuvdb/error.h>
#include <mpuvdb/io.h>

#include <fmt/format.h>

#include <map>

namespace mpuvdb::command
{
namespace
{

class OffsetVerb final : public LevelSetVerb
{
public:
    VerbText text() const override
    {
        return {"offset", "A solid grown by a distance, or shrunk",
                "  mpuvdb offset scan.vdb -o thick.vdb --distance 0.01\n"
                "  mpuvdb offset scan.vdb -o thin.vdb --distance=-2vx\n"};
    }

protected:
    void addOwnOptions(CLI::App& app) override
    {
        addLength(app, "--distance", mDistance, "Distance outward; below 0: inward")->required();
    }

    LevelSet make(const std::vector<GridInput>& inputs, Session& session) override
    {
        const LevelSet& solid = inputs.front().levelSet;
        const double distance = inputs.front().resolve(*mDistance);
        settings()["distance"] = distance;
        session.note("distance    " + lengthText(distance, solid.voxelSize()));
        return Shape(solid).offset(distance).evaluate(settingsLike(solid, session),
                                                      &session.progress());
    }

private:
    std::optional<Length> mDistance;
};

class ShellVerb final : public LevelSetVerb
{
public:
    VerbText text() const override
    {
        return {"shell", "A solid hollowed to a wall along its surface",
                "  mpuvdb shell statue.vdb -o hollow.vdb --thickness 0.003\n"
                "  mpuvdb shell scan.vdb -o skin.vdb --thickness 4vx --wall centered\n"};
    }

protected:
    void addOwnOptions(CLI::App& app) override
    {
        addLength(app, "--thickness", mThickness, "Of the wall, at least two voxels")->required();
        app.add_option("--wall", mWall, "The side of the surface where it lies")
            ->type_name("inward|outward|centered")
            ->check(oneOf({"inward", "outward", "centered", "centred"}))
            ->capture_default_str();
    }

    LevelSet make(const std::vector<GridInput>& inputs, Session& session) override
    {
        const LevelSet& solid = inputs.front().levelSet;
        const double thickness = inputs.front().resolve(*mThickness);
        const Wall wall = mWall == "inward"    ? Wall::Inward
                          : mWall == "outward" ? Wall::Outward
                                               : Wall::Centered;
        settings()["thickness"] = thickness;
        settings()["wall"] = mWall;
        session.note(
            fmt::format("wall        {} {}", lengthText(thickness, solid.voxelSize()), mWall));
        return Shape(solid)
            .shell(thickness, wall)
            .evaluate(settingsLike(solid, session), &session.progress());
    }

private:
    std::optional<Length> mThickness;
    std::string mWall = "inward";
};

const std::map<std::string, Filter> kFilters = {{"mean", Filter::Mean},
                                                {"gaussian", Filter::Gaussian},
                                                {"median", Filter::Median},
                                                {"curvature", Filter::MeanCurvature}};

class SmoothVerb final : public LevelSetVerb
{
public:
    VerbText text() const override
    {
        return {"smooth", "A smoothed surface, everywhere or under a mask",
                "  mpuvdb smooth scan.vdb -o soft.vdb\n"
                "  mpuvdb smooth scan.vdb -o soft.vdb --filter median --width 2 --iterations 3\n"
                "  mpuvdb smooth scan.vdb -o soft.vdb --mask face.vdb --mask-grid density\n"
                "      Only where the grid density of face.vdb is above 0, fully where it is 1.\n"};
    }

protected:
    void addOwnOptions(CLI::App& app) override
    {
        app.add_option("--filter", mFilter,
                       "Mean, Gaussian mean or median of the distances in a cube of voxels, or\n"
                       "flow by mean curvature")
            ->type_name("mean|gaussian|median|curvature")
            ->check(oneOf({"mean", "gaussian", "median", "curvature"}))
            ->capture_default_str();
        app.add_option("--iterations", mSmooth.iterations, "Number of passes, from 1 to 1000")
            ->type_name("N")
            ->capture_default_str();
        mWidth = app.add_option("--width", mSmooth.width,
                                "Half the edge of the cube, from 1 to 32; not for curvature")
                     ->type_name("VOXELS")
                     ->capture_default_str();
        CLI::Option* const mask =
            app.add_option("--mask", mMask, "A .vdb file with a grid of values from 0 to 1")
                ->type_name("MASK.vdb");
        app.add_option("--mask-grid", mMaskGrid, "Name of that grid; default: the first float grid")
            ->type_name("NAME")
            ->needs(mask);
    }

    LevelSet make(const std::vector<GridInput>& inputs, Session& session) override
    {
        const LevelSet& solid = inputs.front().levelSet;
        mSmooth.filter = kFilters.at(mFilter);
        const bool hasWidth = mSmooth.filter != Filter::MeanCurvature;
        if (!hasWidth && mWidth->count() > 0)
            throw UsageError(
                "--width: flow by mean curvature has none. Leave it out, and take more "
                "--iterations for more smoothing");
        if (!mMask.empty())
            mSmooth.mask = readFloatGridFile(mMask, mMaskGrid, session.bytesLeft()).grid;
        settings()["filter"] = mFilter;
        settings()["iterations"] = mSmooth.iterations;
        if (hasWidth) settings()["width"] = mSmooth.width;
        if (mSmooth.mask) settings()["mask"] = mSmooth.mask->getName();
        session.note(fmt::format("filter      {}{}, {} times{}", mFilter,
                                 hasWidth ? fmt::format(", width {} vx", mSmooth.width) : "",
                                 mSmooth.iterations, mSmooth.mask ? ", masked" : ""));
        return Shape(solid).smooth(mSmooth).evaluate(settingsLike(solid, session),
                                                     &session.progress());
    }

private:
    SmoothSettings mSmooth;
    std::string mFilter = "gaussian", mMask, mMaskGrid;
    CLI::Option* mWidth = nullptr;
};

} // namespace

std::unique_ptr<Verb> makeOffset()
{
    return std::make_unique<OffsetVerb>();
}

std::unique_ptr<Verb> makeShell()
{
    return std::make_unique<ShellVerb>();
}

std::unique_ptr<Verb> makeSmooth()
{
    return std::make_unique<SmoothVerb>();
}

} // namespace mpuvdb::command
