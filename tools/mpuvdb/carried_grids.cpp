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

} // namespace

openvdb::GridCPtrVec carriedGrids(const LevelSet& made, const GridInput& input,
                                  const WayBack& wayBack, Session& session)
{
    openvdb::GridCPtrVec grids, kept;
    openvdb::FloatGrid::ConstPtr coverage;
    for (const openvdb::GridBase::ConstPtr& other : input.others) {
        const auto floats = openvdb::gridConstPtrCast<openvdb::FloatGrid>(other);
        if (floats && other->getName() == kCoverageName)
            coverage = floats;
        else if (isMeasured(*other))
            session.warn(fmt::format("its grid '{}' is of the surface as it was, and was left out: "
                                     "run mpuvdb analyze again",
                                     other->getName()));
        else
            kept.push_back(other);
    }
    Interrupter* const progress = &session.progress();
    const Queries solid(input.levelSet); // one for all: it keeps the surface that it extracts
    if (coverage) {
        const CarriedCoverage carried(solid, *coverage, wayBack, *progress);
        if (carried.isKnown())
            grids.push_back(sampleCoverage(made, carried, progress));
        else
            kept.push_back(coverage);
    }
    const CarriedAttributes attributes(solid, kept, wayBack, *progress);
    if (attributes.channels() > 0)
        for (const auto& grid : sampleAttributes(made, attributes, progress)) grids.push_back(grid);
    const auto isCarried = [&](const openvdb::GridBase::ConstPtr& other) {
        return std::any_of(grids.begin(), grids.end(),
                           [&](const auto& grid) { return grid->getName() == other->getName(); });
    };
    std::copy_if(kept.begin(), kept.end(), std::back_inserter(grids),
                 [&](const auto& other) { return !isCarried(other); });
    return grids;
}

} // namespace mpuvdb::command
