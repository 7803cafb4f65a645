// mpuvdb morph: solids between two others, one frame or many.
#include "frames.h"
#include "level_set_verb.h"

#include <algorithm>
#include <filesystem>
#include <fmt/format.h>

namespace mpuvdb::command
{
namespace
{

class MorphVerb final : public Verb
{
public:
    VerbText text() const override
    {
        return {"morph", "A solid between two others, or a sequence of such solids",
                "  mpuvdb morph cube.vdb ball.vdb -o half.vdb --at 0.5\n"
                "  mpuvdb morph cube.vdb ball.vdb --frames 1-24 -o morph.####.vdb\n"
                "      The first frame is the cube, the last the ball.\n"
                "  mpuvdb morph cube.vdb ball.vdb --frames 1-24 --only 7 -o morph.####.vdb\n"
                "      Only frame 7 of them: one task of a render farm.\n"};
    }

    void addOptions(CLI::App& app) override
    {
        app.add_option("from", mFiles[0], "A .vdb file with a level set")->required();
        app.add_option("to", mFiles[1], "Another .vdb file with a level set")->required();
        app.add_option("-o,--output", mOutput,
                       "The level set, - is standard output; for frames a pattern: name.####.vdb,\n"
                       "name.%04d.vdb or name.$F4.vdb")
            ->required()
            ->type_name("OUT.vdb");
        addGridName(app, mGrid);
        CLI::Option* const at =
            app.add_option("--at", mAt, "Position between the two, from 0 to 1; default: 0.5")
                ->type_name("T");
        CLI::Option* const frames =
            app.add_option("--frames", mFrames, "A sequence from 0 to 1: 1-24, or 1-24x2 by steps")
                ->type_name("RANGE")
                ->excludes(at);
        app.add_option("--only", mOnly, "Only this frame of --frames")
            ->type_name("N")
            ->needs(frames);
        app.add_flag("--skip-existing", mSkipExisting, "Skip frames whose file exists")
            ->needs(frames);
        app.add_option("--method", mMethod,
                       "linear: the distances are blended, for shapes that overlap;\n"
                       "advection: the surface moves along its normals, for shapes that differ "
                       "much;\nwhere they do not touch, the first vanishes before the second "
                       "appears")
            ->type_name("linear|advection")
            ->check(oneOf({"linear", "advection"}))
            ->capture_default_str();
        addSharedVoxelSize(app, mVoxelSize);
    }

    ExitCode run(Session& session) override
    {
        const std::vector<Step> steps = plan();
        std::vector<Output> outputs;
        outputs.reserve(steps.size());
        for (const Step& step : steps) outputs.push_back({"-o", step.file, {".vdb"}, true});
        session.checkFiles(outputs, {mFiles[0], mFiles[1]});
        std::vector<GridInput> inputs;
        for (const std::string& file : mFiles)
            inputs.push_back(readGridInput(file, mGrid, session));
        Json settings = {{"method", mMethod}};
        const Shape halfway =
            Shape::morph(Shape(inputs[0].levelSet), Shape(inputs[1].levelSet), 0.5, how());
        const std::vector<LevelSet> ends =
            onOneLattice(inputs, halfway, mVoxelSize, settings, session);
        session.report()["settings"] = settings;
        ExitCode worst = ExitCode::Ok;
        for (const Step& step : steps) {
            const ExitCode code = makeStep(ends, step, inputs.front().others, session);
            if (code != ExitCode::Ok) worst = code;
        }
        session.progress().endStage();
        session.note("time        " + session.timesText());
        return worst;
    }

private:
    struct Step {
        double t;
        std::string file;
    };

    Morphing how() const { return mMethod == "linear" ? Morphing::Linear : Morphing::Advection; }

    std::vector<Step> plan() const
    {
        if (mFrames.empty()) {
            if (!(mAt >= 0 && mAt <= 1))
                throw UsageError(fmt::format("--at {}: must be from 0 to 1", mAt));
            return {{mAt, mOutput}};
        }
        const std::vector<int> frames = parseFrames(mFrames);
        if (mOnly && std::find(frames.begin(), frames.end(), *mOnly) == frames.end())
            throw UsageError(fmt::format("--only {}: is not in --frames {}", *mOnly, mFrames));
        if (!hasFrame(mOutput))
            throw UsageError(fmt::format("-o {}: a sequence needs a place for the frame's number, "
                                         "such as morph.####.vdb",
                                         mOutput));
        std::vector<Step> steps;
        for (const int frame : frames) {
            if (mOnly && frame != *mOnly) continue;
            const std::string file = frameFile(mOutput, frame);
            if (mSkipExisting && std::filesystem::exists(file)) continue;
            const int length = frames.back() - frames.front();
            steps.push_back({length ? double(frame - frames.front()) / length : 0.0, file});
        }
        return steps;
    }

    ExitCode makeStep(const std::vector<LevelSet>& ends, const Step& step,
                      const openvdb::GridCPtrVec& others, Session& session) const
    {
        session.progress().beginStage("morph");
        session.note(fmt::format("morph       at {:.4g}", step.t));
        const LevelSet made = Shape::morph(Shape(ends[0]), Shape(ends[1]), step.t, how())
                                  .evaluate(settingsLike(ends, session), &session.progress());
        return writeGridOutput(made, step.file,
                               {{"mpuvdb:version", MPUVDB_VERSION},
                                {"mpuvdb:operation", "morph"},
                                {"mpuvdb:at", fmt::format("{}", step.t)},
                                {"mpuvdb:method", mMethod}},
                               others, session);
    }

    std::array<std::string, 2> mFiles;
    std::string mOutput, mGrid, mFrames, mMethod = "linear";
    double mAt = 0.5;
    std::optional<int> mOnly;
    std::optional<Length> mVoxelSize;
    bool mSkipExisting = false;
};

} // namespace

std::unique_ptr<Verb> makeMorph()
{
    return std::make_unique<MorphVerb>();
}

} // namespace mpuvdb::command
