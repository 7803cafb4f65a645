// mpuvdb slice: plane cuts of a level set, as contours or as a picture.
#include "level_set_verb.h"

#include "render/slice_picture.h"
#include <mpuvdb/contours.h>
#include <mpuvdb/given_level_set.h>

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace mpuvdb::command
{
namespace
{

class SliceVerb final : public Verb
{
public:
    VerbText text() const override
    {
        return {"slice", "Plane cuts of a solid: contours as SVG, or a picture of the distances",
                "  mpuvdb slice part.vdb -o part.svg --height 0.5\n"
                "  mpuvdb slice part.vdb -o layers.svg --axis z --every 0.2 --units mm\n"
                "      A layer every 0.2 mm, each a group in one file.\n"
                "  mpuvdb slice part.vdb -o part.png --axis x --height 0\n"};
    }

    void addOptions(CLI::App& app) override
    {
        app.add_option("input", mInput,
                       "A .vdb file with a level set; FILE.vdb:NAME names its grid; - is standard\n"
                       "input")
            ->required()
            ->type_name("IN.vdb");
        app.add_option("-o,--output", mOutput,
                       ".svg: closed contours in millimeters, a group for each height; .png: one\n"
                       "slice, warm inside, cool outside, a stripe for each voxel of distance")
            ->required()
            ->type_name("OUT.svg");
        addGridName(app, mGrid);
        app.add_option_function<std::string>(
               "--axis", [this](const std::string& axis) { mAxis = int(axis[0] - 'x'); },
               "The axis across the planes; default: z. The next axis, in the order x, y, z, x,\n"
               "points right, and the one after it up")
            ->type_name("x|y|z")
            ->check(oneOf({"x", "y", "z"}));
        CLI::Option* const heights =
            app.add_option("--height", mHeights,
                           "Where the planes lie along the axis; default: the middle of the solid")
                ->type_name("LENGTH");
        addLength(app, "--every", mEvery,
                  "Instead: layers of this height from the solid's lower end on, each cut in its\n"
                  "middle, as printers do")
            ->excludes(heights);
        app.add_option("--pixels", mPixels, "Pixels along the longer side of a picture")
            ->type_name("N")
            ->capture_default_str();
        app.add_option_function<std::string>(
               "--units",
               [this](const std::string& name) { mMetersPerUnit = unitNames().at(name); },
               "The world's unit: SVG is in millimeters; default: m")
            ->type_name("m|cm|mm|in|ft")
            ->check(oneOf({"m", "cm", "mm", "in", "ft"}));
        app.callback([this, &app] {
            for (const auto& [option, format] :
                 {std::pair{"--units", ".svg"}, {"--pixels", ".png"}})
                if (app.count(option) > 0 && extensionOf(mOutput) != format)
                    throw UsageError(fmt::format("{} is for {} files: leave it out, or write one",
                                                 option, format));
        });
    }

    ExitCode run(Session& session) override
    {
        session.checkFiles({{"-o", mOutput, {".svg", ".png"}}}, {gridPlace(mInput, mGrid).file});
        const GridInput input = readGridInput(mInput, mGrid, session);
        const std::vector<double> heights = chosenHeights(input, session);
        session.report()["settings"] = {{"axis", std::string(1, "xyz"[mAxis])},
                                        {"heights", heights},
                                        {"meters_per_unit", mMetersPerUnit}};
        const bool isMet = extensionOf(mOutput) == ".png"
                               ? writePicture(input.levelSet, onlyOf(heights), session)
                               : writeSvg(input.levelSet, heights, session);
        if (!isMet)
            session.warn("no slice meets the solid. Its box is printed by mpuvdb components");
        session.progress().endStage();
        session.note("time        " + session.timesText());
        const std::string missing = missingBand(input.levelSet, &session.progress());
        if (missing.empty()) return ExitCode::Ok;
        session.warn(missing + ". The slices follow the signs: look at them, and see mpuvdb check");
        return ExitCode::CheckFailed;
    }

private:
    static const std::map<std::string, double>& unitNames()
    {
        static const std::map<std::string, double> units = {
            {"m", 1}, {"cm", 0.01}, {"mm", 0.001}, {"in", 0.0254}, {"ft", 0.3048}};
        return units;
    }

    std::vector<double> chosenHeights(const GridInput& input, Session& session) const
    {
        std::vector<double> heights;
        for (const std::string& text : mHeights)
            heights.push_back(input.resolve(Length::parse(text)));
        if (!heights.empty()) return heights;
        if (input.levelSet.bounds().isEmpty())
            throw InputError(fmt::format("{}: the level set is empty", mInput));
        if (!mEvery) return {input.levelSet.bounds().center()[mAxis]};
        const SolidComponents parts(input.levelSet, &session.progress());
        Box3d box; // of the zero set
        for (const ComponentMeasures& part : parts.measures()) box.extend(part.bounds);
        const double layer = input.resolve(*mEvery), size = box.sizes()[mAxis];
        constexpr double kMostLayers = 100000; // [derived: far more than printers make]
        if (!(layer > 0 && size / layer <= kMostLayers))
            throw UsageError(fmt::format("--every {}: must be above 0, and make at most {} layers",
                                         mEvery->text(), kMostLayers));
        for (int n = 0; (n + 0.5) * layer < size; ++n)
            heights.push_back(box.min()[mAxis] + (n + 0.5) * layer);
        return heights;
    }

    static double onlyOf(const std::vector<double>& heights)
    {
        if (heights.size() != 1)
            throw UsageError("a picture shows one slice. Give one --height, or write .svg, or "
                             "--frames with --height 0.#### and name.####.png");
        return heights.front();
    }

    /// @return whether the slice meets the solid's box.
    bool writePicture(const LevelSet& levelSet, double height, Session& session)
    {
        writeSlicePicture(mOutput, levelSet, {mAxis, height}, mPixels, &session.progress());
        const Box3d box = Shape(levelSet).bounds();
        return !box.isEmpty() && box.min()[mAxis] <= height && height <= box.max()[mAxis];
    }

    /// @return whether a slice meets the solid.
    bool writeSvg(const LevelSet& levelSet, const std::vector<double>& heights, Session& session)
    {
        const std::vector<Slice> slices = slicesOf(levelSet, mAxis, heights, &session.progress());
        Json list = Json::array();
        std::size_t contours = 0;
        for (const Slice& slice : slices) {
            double area = 0;
            for (const Contour& contour : slice.contours) area += contour.area;
            contours += slice.contours.size();
            list.push_back(
                {{"height", slice.height}, {"contours", slice.contours.size()}, {"area", area}});
        }
        session.report()["slices"] = list;
        writeContours(mOutput, slices, mAxis, levelSet.bounds(), mMetersPerUnit,
                      &session.progress());
        session.note(
            fmt::format("slices      {} with {} contours: {}", slices.size(), contours, mOutput));
        return contours > 0;
    }

    std::string mInput, mOutput, mGrid;
    std::vector<std::string> mHeights;
    std::optional<Length> mEvery;
    int mAxis = 2, mPixels = 1024;
    double mMetersPerUnit = 1;
};

} // namespace

std::unique_ptr<Verb> makeSlice()
{
    return std::make_unique<SliceVerb>();
}

} // namespace mpuvdb::command
