#include "points/indexed.h"

#include <mpuvdb/clean.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/outliers.h>

#include <fmt/format.h>

namespace mpuvdb
{
namespace
{

/// The number of points from which outliers and flipped normals are looked for. [tuned:
/// clean_points_test; fewer points leave too few neighbors to compare a point with]
constexpr std::size_t kJudgedFrom = 1000;
/// The noise of sheets that normals distinguish, spacings, is less. [derived: what measure() takes
/// for thin, 0.22 of the radius of a disc with its fewest neighbors, 40]
constexpr double kOfSheet = 0.8;

/// The steps of clean(), on one index of the points.
class Cleaner
{
public:
    Cleaner(PointCloud& cloud, const CleanSettings& settings, Interrupter& progress)
        : mCloud(cloud), mSettings(settings), mProgress(progress),
          mIndex(sortPoints(cloud, progress)), mIsJudged(cloud.size() >= kJudgedFrom)
    {
    }

    CleanReport run()
    {
        mReport.hadNormals = mCloud.hasNormals();
        mReport.statistics = measure(mCloud, *mIndex, mProgress);
        const bool fillSolid = mReport.statistics.fillSolid;
        if (mIsJudged && mSettings.dropOutliers) leaveOutOutliers();
        if (seeToNormals()) measureByNormals();
        if (mReport.estimateNeighbors) {
            // Normals that come from the positions know nothing that these do not say; but two
            // sheets that they are of are no solid.
            PointStatistics& s = mReport.statistics;
            s.normalNoise = 0;
            s.fillSolid = fillSolid && s.noise > kOfSheet * s.spacing;
        }
        if (mSettings.flipNormals) flipNormals(mCloud);
        mReport.inward = pointsInward(mCloud);
        return mReport;
    }

private:
    void leaveOutOutliers()
    {
        mCells.emplace(*mIndex, sideForOutliers(mReport.statistics), mProgress);
        const auto outliers = findOutliers(mCloud, *mCells, mReport.statistics, mProgress);
        mReport.outliers += outliers.size();
        if (outliers.empty()) return;
        mCells.reset();
        mIndex = mIndex->without(outliers, mProgress);
        dropPoints(mCloud, outliers);
    }

    /// Measure what normals tell. Without them the two sides of a thin wall were one noisy sheet,
    /// off which little is: what is off them is left out now.
    void measureByNormals()
    {
        const double before = mReport.statistics.noise;
        mReport.statistics = measure(mCloud, *mIndex, mProgress);
        if (!mIsJudged || !mSettings.dropOutliers || !(mReport.statistics.noise < before / 2))
            return;
        const std::size_t all = mCloud.size();
        leaveOutOutliers();
        if (mCloud.size() < all) mReport.statistics = measure(mCloud, *mIndex, mProgress);
    }

    /// Estimate normals, or turn those that are flipped, and those of solids that are inside out.
    /// @return whether so much changed that it had spoilt what was measured.
    bool seeToNormals()
    {
        const NormalsFrom from = mSettings.normals;
        if (from == NormalsFrom::Estimate || !mCloud.hasNormals()) {
            const EstimatedNormals estimated = estimateNormals(mCloud, *mIndex, {}, mProgress);
            mReport.estimateNeighbors = estimated.neighbors;
            mReport.onLines = double(estimated.onLines) / double(mCloud.size());
            mReport.unclosed = double(estimated.unclosed) / double(mCloud.size());
            return true;
        }
        // A range image knows its outside.
        if (from == NormalsFrom::Keep || !mCloud.seenFrom.empty()) return false;
        if (mIsJudged) turnFlipped();
        if (!mSettings.flipNormals) { // who turns all knows which way they look
            const auto inward = findInwardSolids(mCloud, *mIndex, mReport.statistics, mProgress);
            flipNormals(mCloud, inward);
            mReport.turned = inward.size();
        }
        return mReport.flipped > mCloud.size() / 100;
    }

    void turnFlipped()
    {
        const double side = sideForFlipped(mReport.statistics);
        if (!mCells || mCells->side() != side) mCells.emplace(*mIndex, side, mProgress);
        const auto flipped = findFlippedNormals(mCloud, *mCells, mReport.statistics, mProgress);
        flipNormals(mCloud, flipped);
        mReport.flipped = flipped.size();
    }

    PointCloud& mCloud;
    const CleanSettings& mSettings;
    Interrupter& mProgress;
    std::shared_ptr<const PointIndex> mIndex;
    std::optional<PointCells> mCells; ///< of mIndex, as far as they are known
    bool mIsJudged;
    CleanReport mReport;
};

} // namespace

std::string CleanReport::tooThin() const
{
    /// Share of all points. [tuned: none of 29 real clouds has more than 0.045; walls that get
    /// holes, or swell, have 0.12 and more]
    constexpr double kMaxThin = 0.1;
    const double share = estimateNeighbors ? statistics.thinForNoise : statistics.thin;
    if (share <= kMaxThin) return {};
    const std::string part =
        fmt::format("{:.0f} % of the points have the other side of their part", 100 * share);
    if (estimateNeighbors)
        return part + " less than 1.5 spacings or 8 times the noise behind them, so that estimated "
                      "normals are guesses: walls may swell, or get holes. Give points with "
                      "normals, more points, or ones with less noise";
    return part + " less than 1.5 spacings behind them, which so few points hardly tell apart: "
                  "walls may get holes. Give more points";
}

CleanReport clean(PointCloud& cloud, const CleanSettings& settings, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    progress.beginStage("clean");
    cloud.demandWhole();
    return Cleaner(cloud, settings, progress).run();
}

} // namespace mpuvdb
