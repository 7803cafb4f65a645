// mpuvdb union, intersection, difference: solids as one.
#include "level_set_verb.h"

#include <fmt/format.h>

namespace mpuvdb::command
{
namespace
{

class BooleanVerb final : public LevelSetVerb
{
public:
    BooleanVerb(Boolean kind, const VerbText& text) : mKind(kind), mText(text) {}

    VerbText text() const override { return mText; }

protected:
    Count inputCount() const override { return {1, 0}; }

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

} // namespace

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
