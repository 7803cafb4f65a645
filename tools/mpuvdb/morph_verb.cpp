// mpuvdb morph: solids between two others, one frame or many.
#include "carried_grids.h"

#include <array>
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
                "      Only frame 7 of them: one task of a render farm.\n"
                "  mpuvdb morph walk.####.vdb run.####.vdb --frames 1-24 -o change.####.vdb\n"
                "      Two sequences: from the first frame of one to the last of the other.\n"};
    }

    void addOptions(CLI::App& app) override
    {
        app.add_option("from", mFiles[0],
                       "A .vdb file with a level set; FILE.vdb:NAME names its grid")
            ->required();
        app.add_option("to", mFiles[1], "Another .vdb file with a level set")->required();
        app.add_option("-o,--output", mOutput, "The level set; - is standard output")
            ->required()
            ->type_name("OUT.vdb");
        addGridName(app, mGrid);
        app.add_option("--at", mAt,
                       "Position between the two, from 0 to 1; default: 0.5, and with --frames\n"
                       "from 0 in the first of them to 1 in the last")
            ->type_name("T");
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

    bool movesByItself() const override { return !mAt; }

    ExitCode run(Session& session) override
    {
        const std::optional<Frame>& frame = session.options().frame;
        const double t = mAt.value_or(frame ? frame->position() : 0.5);
        if (!(t >= 0 && t <= 1)) throw UsageError(fmt::format("--at {}: must be from 0 to 1", t));
        session.checkFiles({{"-o", mOutput, {".vdb"}, true}},
                           {gridPlace(mFiles[0], mGrid).file, gridPlace(mFiles[1], mGrid).file});
        std::vector<GridInput> inputs;
        for (const std::string& file : mFiles)
            inputs.push_back(readGridInput(file, mGrid, session));
        Json settings = {{"method", mMethod}, {"at", t}};
        const Shape halfway =
            Shape::morph(Shape(inputs[0].levelSet), Shape(inputs[1].levelSet), 0.5, how());
        const std::vector<LevelSet> ends =
            onOneLattice(inputs, halfway, mVoxelSize, settings, session);
        session.report()["settings"] = settings;
        session.progress().beginStage("morph");
        session.note(fmt::format("morph       at {:.4g}", t));
        const LevelSet made = Shape::morph(Shape(ends[0]), Shape(ends[1]), t, how())
                                  .evaluate(settingsLike(ends, session), &session.progress());
        const ExitCode code = writeGridOutput(made, mOutput,
                                              {{"mpuvdb:version", MPUVDB_VERSION},
                                               {"mpuvdb:operation", "morph"},
                                               {"mpuvdb:at", fmt::format("{}", t)},
                                               {"mpuvdb:method", mMethod}},
                                              morphedGrids(made, inputs[0], inputs[1], t, session),
                                              session, inputs.front().metadata);
        session.progress().endStage();
        session.note("time        " + session.timesText());
        return code;
    }

private:
    Morphing how() const { return mMethod == "linear" ? Morphing::Linear : Morphing::Advection; }

    std::array<std::string, 2> mFiles;
    std::string mOutput, mGrid, mMethod = "linear";
    std::optional<double> mAt;
    std::optional<Length> mVoxelSize;
};

} // namespace

std::unique_ptr<Verb> makeMorph()
{
    return std::make_unique<MorphVerb>();
}

} // namespace mpuvdb::command
