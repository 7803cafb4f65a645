// mpuvdb check: is it a sound level set?
#include "describe.h"
#include "standard_output.h"
#include "verb.h"

#include <mpuvdb/io.h>

#include <algorithm>
#include <fmt/format.h>

namespace mpuvdb::command
{
namespace
{

using Grids = std::vector<openvdb::FloatGrid::ConstPtr>;

/// The grid called @a name; or all level sets; or, where there is none, all grids of floats.
Grids gridsToCheck(const std::string& file, const std::string& name, std::uint64_t maxBytes)
{
    Grids floats;
    for (const openvdb::GridBase::Ptr& grid : readGrids(file, maxBytes)) {
        const auto floatGrid = openvdb::gridPtrCast<openvdb::FloatGrid>(grid);
        if (floatGrid && (name.empty() || grid->getName() == name)) floats.push_back(floatGrid);
    }
    const auto isLevelSet = [](const auto& grid) {
        return grid->getGridClass() == openvdb::GRID_LEVEL_SET;
    };
    const auto others = std::stable_partition(floats.begin(), floats.end(), isLevelSet);
    if (others != floats.begin()) floats.erase(others, floats.end());
    return floats;
}

class Check final : public Verb
{
public:
    VerbText text() const override
    {
        return {"check", "Whether .vdb files hold sound level sets; exit status 4 if not",
                "  mpuvdb check scan.vdb\n"
                "  mpuvdb check frames/*.vdb --quiet && echo all sound\n"};
    }

    void addOptions(CLI::App& app) override
    {
        app.add_option("input", mInputs, "One or more .vdb files")->required();
        app.add_option("--grid", mGrid, "Check this grid only; default: all level sets")
            ->type_name("NAME");
        app.add_flag("--json", mJson, "Print JSON");
    }

    ExitCode run(Session& session) override
    {
        session.checkFiles({}, mInputs);
        for (const std::string& file : mInputs) checkFile(session, file);
        session.report()["files"] = mFiles;
        if (mJson) printText(Json{{"files", mFiles}}.dump(2) + "\n");
        return mSound ? ExitCode::Ok : ExitCode::CheckFailed;
    }

private:
    void checkFile(Session& session, const std::string& file)
    {
        Json grids = Json::array();
        for (const auto& grid : gridsToCheck(file, mGrid, session.options().maxBytes)) {
            const CheckReport report = check(*grid, session.progress());
            mSound = mSound && report.sound();
            grids.push_back({{"name", grid->getName()}});
            grids.back().update(toJson(report));
            if (!mJson) print(session, file, grid->getName(), report);
        }
        if (grids.empty()) {
            mSound = false;
            session.warn(fmt::format("{}: no level set{} in it", file,
                                     mGrid.empty() ? "" : " called " + mGrid));
        }
        mFiles.push_back({{"file", file}, {"grids", grids}});
    }

    static void print(const Session& session, const std::string& file, const std::string& name,
                      const CheckReport& report)
    {
        if (report.sound() && session.options().quiet) return;
        std::string text =
            fmt::format("{}: {}: {} ({} active voxels, mean ||grad| - 1| {:.4f}, largest {:.3f})\n",
                        file, name, report.sound() ? "sound" : "NOT a sound level set",
                        report.activeVoxels, report.meanGradientError, report.maxGradientError);
        for (const CheckFinding& finding : report.findings)
            text += "    " + findingText(finding) + "\n";
        printText(text);
    }

    std::vector<std::string> mInputs;
    std::string mGrid;
    bool mJson = false;
    bool mSound = true;
    Json mFiles = Json::array();
};

} // namespace

std::unique_ptr<Verb> makeCheck()
{
    return std::make_unique<Check>();
}

} // namespace mpuvdb::command
