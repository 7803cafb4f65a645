// mpuvdb render: a level set to a picture.
#include "level_set_verb.h"
#include "standard_output.h"

#include "render/picture.h"
#include <mpuvdb/io.h>

#include <charconv>
#include <fmt/format.h>

#include <optional>

namespace mpuvdb::command
{
namespace
{

/// Two numbers of pixels: "800x600".
std::pair<int, int> parsePictureSize(const std::string& text)
{
    int width = 0, height = 0;
    const char* const end = text.data() + text.size();
    const auto w = std::from_chars(text.data(), end, width);
    if (w.ec == std::errc() && w.ptr != end && *w.ptr == 'x') {
        const auto h = std::from_chars(w.ptr + 1, end, height);
        if (h.ec == std::errc() && h.ptr == end) return {width, height};
    }
    throw UsageError(fmt::format("--size: '{}' is not a size in pixels: write 800x600", text));
}

class Render final : public Verb
{
public:
    VerbText text() const override
    {
        return {
            "render", "A level set to a shaded picture",
            "  mpuvdb render scan.vdb -o scan.png\n"
            "  mpuvdb render scan.vdb -o top.png --size 1200x900 --azimuth 120 --elevation 80\n"};
    }

    void addOptions(CLI::App& app) override
    {
        app.add_option("input", mInput,
                       "A .vdb file with a level set, or FILE.vdb:NAME; - is standard input")
            ->required();
        app.add_option("-o,--output", mOutput, "The picture")->required()->type_name("OUT.png");
        addGridName(app, mGrid);
        app.add_option_function<std::string>(
               "--size",
               [this](const std::string& text) {
                   std::tie(mPicture.width, mPicture.height) = parsePictureSize(text);
               },
               "Pixels; default: 800x600")
            ->type_name("WxH");
        addUpAxis(app, mPicture.up, "The world's up axis; default: y");
        app.add_option("--azimuth", mPicture.azimuth, "Angle of the camera about that axis")
            ->type_name("DEGREES")
            ->capture_default_str();
        app.add_option("--elevation", mPicture.elevation, "Angle of the camera above the horizon")
            ->type_name("DEGREES")
            ->capture_default_str();
    }

    ExitCode run(Session& session) override
    {
        const GridPlace place = gridPlace(mInput, mGrid);
        session.checkFiles({{"-o", mOutput, {".png"}}}, {place.file});
        session.progress().beginStage("read");
        std::optional<LevelSet> read;
        readFile(place.file, ".vdb", [&](const std::filesystem::path& file) {
            read =
                readLevelSet(file, place.grid, session.options().maxBytes, Validation::SignsOnly);
        });
        const LevelSet& levelSet = *read;
        session.hold(levelSet.grid().memUsage());
        mPicture.maxBytes = session.bytesLeft();
        session.report()["settings"] = {{"width", mPicture.width},
                                        {"height", mPicture.height},
                                        {"azimuth", mPicture.azimuth},
                                        {"elevation", mPicture.elevation},
                                        {"up", mPicture.up == UpAxis::Z ? "z" : "y"}};
        session.report()["grid"] = toJson(levelSet);
        writePicture(mOutput, levelSet, mPicture, &session.progress());
        session.progress().endStage();
        session.note(
            fmt::format("picture     {} x {}: {}", mPicture.width, mPicture.height, mOutput));
        if (levelSet.grid().activeVoxelCount() == 0)
            session.warn(fmt::format("{}: nothing is there: the level set is empty", mOutput));
        return ExitCode::Ok;
    }

private:
    std::string mInput, mOutput, mGrid;
    PictureSettings mPicture;
};

} // namespace

std::unique_ptr<Verb> makeRender()
{
    return std::make_unique<Render>();
}

} // namespace mpuvdb::command
