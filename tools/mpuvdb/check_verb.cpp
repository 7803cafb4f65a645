// mpuvdb check: whether files hold sound level sets.
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

/// The grids to check, and names and classes of the others.
struct Found {
    Grids grids;
    std::vector<std::string> others;
};

/// The float grid called @a name, or, if that is empty, all level sets.
Found gridsToCheck(const std::string& file, const std::string& name, std::uint64_t maxBytes)
{
    Found found;
    for (const openvdb::GridBase::Ptr& grid : readGrids(file, maxBytes)) {
        const auto floatGrid = openvdb::gridPtrCast<openvdb::FloatGrid>(grid);
        const bool isMeant = name.empty() ? grid->getGridClass() == openvdb::GRID_LEVEL_SET
                                          : grid->getName() == name;
        if (floatGrid && isMeant)
            found.grids.push_back(floatGrid);
        else
            found.others.push_back(fmt::format(
                "'{}' ({}, {})", grid->getName(),
                openvdb::GridBase::gridClassToString(grid->getGridClass()), grid->valueType()));
    }
    return found;
}

class Check final : public Verb
{
public:
    VerbText text() const override
    {
        return {"check",
                "Whether .vdb files hold sound level sets; exit status 4 if not, 3 if one has none",
                "  mpuvdb check scan.vdb\n"
                "  mpuvdb check frames/*.vdb --quiet && echo all sound\n"};
    }

    void addOptions(CLI::App& app) override
    {
        app.add_option("input", mInputs, "One or more .vdb files; - is standard input")->required();
        app.add_option("--grid", mGrid,
                       "Check this float grid only, of any class; default: all level sets")
            ->type_name("NAME");
        app.add_flag("--json", mJson, "Print JSON");
    }

    ExitCode run(Session& session) override
    {
        session.checkFiles({}, mInputs);
        for (const std::string& file : mInputs) tryFile(session, file);
        session.report()["files"] = mFiles;
        if (mJson) session.printJson({{"files", mFiles}});
        return mMissing ? ExitCode::BadInput : mSound ? ExitCode::Ok : ExitCode::CheckFailed;
    }

private:
    /// Checks a file; one that cannot be read becomes a warning.
    void tryFile(Session& session, const std::string& file)
    {
        try {
            checkFile(session, file);
        } catch (const Error& e) {
            if (exitCodeOf(e) != ExitCode::BadInput) throw;
            mMissing = true;
            session.warn(e.what());
            mFiles.push_back({{"file", file}, {"error", e.what()}});
        }
    }

    void checkFile(Session& session, const std::string& file)
    {
        Json grids = Json::array();
        Found found;
        readFile(file, ".vdb", [&](const std::filesystem::path& path) {
            found = gridsToCheck(path, mGrid, session.options().maxBytes);
        });
        for (const auto& grid : found.grids) {
            const CheckReport report =
                check(*grid, kGradientTolerance, openvdb::CoordBBox::inf(), &session.progress());
            mSound = mSound && report.sound();
            grids.push_back({{"name", grid->getName()}});
            grids.back().update(toJson(report));
            if (!mJson) print(session, file, grid->getName(), report);
        }
        if (grids.empty()) {
            mMissing = true;
            session.warn(fmt::format(
                "{}: has no {}, but {}. Name a float grid with --grid", file,
                mGrid.empty() ? "level set" : "float grid called '" + mGrid + "'",
                found.others.empty() ? "no grid at all"
                                     : fmt::format("{}", fmt::join(found.others, ", "))));
        }
        mFiles.push_back({{"file", file}, {"grids", grids}});
    }

    static void print(const Session& session, const std::string& file, const std::string& name,
                      const CheckReport& report)
    {
        if (report.sound() && session.options().quiet) return;
        const char* const verdict = !report.sound()            ? "NOT a sound level set"
                                    : report.activeVoxels == 0 ? "sound, but empty"
                                                               : "sound";
        std::string text = fmt::format(
            "{}: {}: {} ({} active voxels, mean ||grad| - 1| {:.4f}, largest {:.3f})\n", file, name,
            verdict, report.activeVoxels, report.meanGradientError, report.maxGradientError);
        for (const CheckFinding& finding : report.findings)
            text += "    " + findingText(finding) + "\n";
        printText(text);
    }

    std::vector<std::string> mInputs;
    std::string mGrid;
    bool mJson = false;
    bool mSound = true, mMissing = false; ///< all are sound; one has no level set
    Json mFiles = Json::array();
};

} // namespace

std::unique_ptr<Verb> makeCheck()
{
    return std::make_unique<Check>();
}

} // namespace mpuvdb::command
