#include "carried_grids.h"

#include <mpuvdb/attribute_grids.h>
#include <mpuvdb/carried_attributes.h>
#include <mpuvdb/queries.h>
#include <mpuvdb/sampling.h>

#include <algorithm>
#include <fmt/format.h>
#include <iterator>
#include <utility>

namespace mpuvdb::command
{
namespace
{

/// Attributes of a surface that was moved or changed, on what became of it.
class CarriedAttributes final : public SurfaceAttributes
{
public:
    /// @param solid  as it was; outlives this, and so does @a progress.
    /// @param grids  those that hold the attributes; of the solid's file.
    CarriedAttributes(const Queries& solid, const openvdb::GridCPtrVec& grids, WayBack wayBack,
                      const Interrupter& progress)
        : mSolid(solid), mOwn(attributesOfOperands({{solid.levelSet(), grids}})),
          mWayBack(std::move(wayBack)), mStop({}, [&progress] { return progress.stopped(); })
    {
    }

    bool hasColors() const override { return mOwn->hasColors(); }
    const std::vector<std::string>& scalarNames() const override { return mOwn->scalarNames(); }

    void evaluate(const std::vector<SurfacePlace>& places,
                  std::vector<float>& values) const override
    {
        std::vector<Vec3d> there;
        there.reserve(places.size());
        for (const SurfacePlace& place : places) there.push_back(place.position);
        if (mWayBack) mWayBack(there);
        std::vector<Vec3d> feet(there.size());
        mSolid.closestPoints(there, feet.data(), &mStop);
        std::vector<SurfacePlace> own = places;
        for (std::size_t n = 0; n < own.size(); ++n) own[n].position = feet[n];
        mOwn->evaluate(own, values);
    }

private:
    const Queries& mSolid;
    std::unique_ptr<SurfaceAttributes> mOwn;
    WayBack mWayBack;
    mutable Interrupter mStop; ///< hears of no stages, which would end the one that asks
};

/// A coverage that was carried, as an attribute.
class CarriedCoverage final : public Coverage
{
public:
    CarriedCoverage(const Queries& solid, const openvdb::FloatGrid& coverage,
                    const WayBack& wayBack, const Interrupter& progress)
        : mValues(solid, {renamed(coverage)}, wayBack, progress), mSpacing(coverageScale(coverage))
    {
    }

    /// Whether it lies on the band's voxels; else nothing of it can be carried.
    bool isKnown() const { return mValues.channels() == 1; }
    void evaluate(const std::vector<SurfacePlace>& places,
                  std::vector<float>& values) const override
    {
        mValues.evaluate(places, values);
    }
    double spacing() const override { return mSpacing; }

private:
    /// The same voxels by a name that stands for no coverage.
    static openvdb::GridBase::ConstPtr renamed(const openvdb::FloatGrid& coverage)
    {
        openvdb::MetaMap named;
        named.insertMeta(openvdb::GridBase::META_GRID_NAME, openvdb::StringMetadata("value"));
        return coverage.copyReplacingMetadata(named);
    }

    CarriedAttributes mValues;
    double mSpacing;
};

/// Whether @a grid is one that analyze makes.
bool isMeasured(const openvdb::GridBase& grid)
{
    const std::string name = grid.getName();
    return name == "normals" || name == "curvature" || name == "thickness";
}

/// Attributes on what lies between two surfaces: those of both, mixed.
class MorphedAttributes final : public SurfaceAttributes
{
public:
    /// @param t  weight of @a to, in [0, 1]; both outlive this.
    MorphedAttributes(const SurfaceAttributes& from, const SurfaceAttributes& to, double t)
        : mFrom(from), mTo(to), mWeight(float(t)), mNames(from.scalarNames())
    {
        for (const std::string& name : to.scalarNames())
            if (std::find(mNames.begin(), mNames.end(), name) == mNames.end())
                mNames.push_back(name);
    }

    bool hasColors() const override { return mFrom.hasColors() || mTo.hasColors(); }
    const std::vector<std::string>& scalarNames() const override { return mNames; }

    void evaluate(const std::vector<SurfacePlace>& places,
                  std::vector<float>& values) const override
    {
        values.assign(places.size() * channels(), 0);
        std::vector<float> ofOne;
        for (const SurfaceAttributes* const one : {&mFrom, &mTo}) {
            one->evaluate(places, ofOne);
            const std::vector<std::size_t> own = channelsOf(*one);
            for (std::size_t c = 0; c < own.size(); ++c) {
                const float weight = weightOf(own[c], one == &mTo);
                for (std::size_t n = 0; n < places.size(); ++n)
                    values[n * channels() + own[c]] += weight * ofOne[n * own.size() + c];
            }
        }
    }

private:
    /// The channels here of those of one of the two.
    std::vector<std::size_t> channelsOf(const SurfaceAttributes& one) const
    {
        std::vector<std::size_t> own;
        if (one.hasColors()) own = {0, 1, 2};
        for (const std::string& name : one.scalarNames())
            own.push_back(
                (hasColors() ? 3 : 0) +
                std::size_t(std::find(mNames.begin(), mNames.end(), name) - mNames.begin()));
        return own;
    }
    bool has(const SurfaceAttributes& one, std::size_t channel) const
    {
        const std::vector<std::size_t> own = channelsOf(one);
        return std::find(own.begin(), own.end(), channel) != own.end();
    }
    /// What only one of the two has is that one's.
    float weightOf(std::size_t channel, bool isTo) const
    {
        if (!has(isTo ? mFrom : mTo, channel)) return 1;
        return isTo ? mWeight : 1 - mWeight;
    }

    const SurfaceAttributes &mFrom, &mTo;
    float mWeight;
    std::vector<std::string> mNames;
};

/// The grids beside a level set: those that go along, and the coverage.
struct Beside {
    openvdb::GridCPtrVec kept;
    openvdb::FloatGrid::ConstPtr coverage;
};

/// Those of @a input, without what analyze measured.
Beside besideOf(const GridInput& input, Session& session)
{
    Beside beside;
    for (const openvdb::GridBase::ConstPtr& other : input.others) {
        const auto floats = openvdb::gridConstPtrCast<openvdb::FloatGrid>(other);
        if (floats && other->getName() == kCoverageName)
            beside.coverage = floats;
        else if (isMeasured(*other))
            session.warn(fmt::format("its grid '{}' is of the surface as it was, and was left out: "
                                     "run mpuvdb analyze again",
                                     other->getName()));
        else
            beside.kept.push_back(other);
    }
    return beside;
}

/// The grids of attributes for @a made, and those of @a kept that are none of them.
openvdb::GridCPtrVec withAttributes(const LevelSet& made, const SurfaceAttributes& attributes,
                                    const openvdb::GridCPtrVec& kept, Interrupter* progress)
{
    openvdb::GridCPtrVec grids;
    if (attributes.channels() > 0)
        for (const auto& grid : sampleAttributes(made, attributes, progress)) grids.push_back(grid);
    std::copy_if(kept.begin(), kept.end(), std::back_inserter(grids), [&](const auto& other) {
        return std::none_of(grids.begin(), grids.end(),
                            [&](const auto& grid) { return grid->getName() == other->getName(); });
    });
    return grids;
}

/// The coverage beside @a solid for @a made; where it cannot be carried, it goes along as it is.
openvdb::GridCPtrVec carriedCoverage(const LevelSet& made, const Queries& solid, Beside& beside,
                                     const WayBack& wayBack, Interrupter* progress)
{
    if (!beside.coverage) return {};
    const CarriedCoverage carried(solid, *beside.coverage, wayBack, *progress);
    if (carried.isKnown()) return {sampleCoverage(made, carried, progress)};
    beside.kept.push_back(beside.coverage);
    return {};
}

} // namespace

openvdb::GridCPtrVec carriedGrids(const LevelSet& made, const GridInput& input,
                                  const WayBack& wayBack, Session& session)
{
    Interrupter* const progress = &session.progress();
    Beside beside = besideOf(input, session);
    const Queries solid(input.levelSet); // one for all: it keeps the surface that it extracts
    openvdb::GridCPtrVec grids = carriedCoverage(made, solid, beside, wayBack, progress);
    const CarriedAttributes attributes(solid, beside.kept, wayBack, *progress);
    for (const auto& grid : withAttributes(made, attributes, beside.kept, progress))
        grids.push_back(grid);
    return grids;
}

openvdb::GridCPtrVec morphedGrids(const LevelSet& made, const GridInput& from, const GridInput& to,
                                  double t, Session& session)
{
    Interrupter* const progress = &session.progress();
    Beside ofFrom = besideOf(from, session), ofTo = besideOf(to, session);
    const Queries start(from.levelSet), end(to.levelSet);
    openvdb::GridCPtrVec grids = t < 0.5 ? carriedCoverage(made, start, ofFrom, {}, progress)
                                         : carriedCoverage(made, end, ofTo, {}, progress);
    const CarriedAttributes first(start, ofFrom.kept, {}, *progress),
        last(end, ofTo.kept, {}, *progress);
    for (const auto& grid :
         withAttributes(made, MorphedAttributes(first, last, t), ofFrom.kept, progress))
        grids.push_back(grid);
    return grids;
}

} // namespace mpuvdb::command
