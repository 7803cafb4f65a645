#include <mpuvdb/clean.h>

#include <mpuvdb/interrupter.h>
#include <mpuvdb/normals.h>
#include <mpuvdb/outliers.h>

namespace mpuvdb
{
namespace
{

constexpr std::size_t kJudgedFrom = 1000; ///< fewer points say little of each other
/// Spacings: noise of sheets that normals tell apart is less. [derived: what measure() takes for
/// thin, 0.22 of the radius of a disc with its fewest neighbors, 40]
constexpr double kOfSheet = 0.8;

/// Estimate normals, or turn those that are flipped if they can be @a judged, and those of solids
/// that are inside out. @return whether so much changed that it had spoilt what was measured.
bool seeToNormals(PointCloud& cloud, bool judged, const CleanSettings& settings,
                  CleanReport& report, Interrupter& progress)
{
    const NormalsFrom from = settings.normals;
    if (from == NormalsFrom::Estimate || !cloud.hasNormals()) {
        const EstimatedNormals estimated = estimateNormals(cloud, {}, &progress);
        report.estimateNeighbors = estimated.neighbors;
        report.onLines = double(estimated.onLines) / double(cloud.size());
        return true;
    }
    // A range image knows its outside.
    if (from == NormalsFrom::Keep || !cloud.seenFrom.empty()) return false;
    if (judged) {
        const auto flipped = findFlippedNormals(cloud, report.statistics, &progress);
        flipNormals(cloud, flipped);
        report.flipped = flipped.size();
    }
    if (!settings.flipNormals) { // who turns all knows which way they look
        const auto inward = findInwardSolids(cloud, report.statistics, &progress);
        flipNormals(cloud, inward);
        report.turned = inward.size();
    }
    return report.flipped > cloud.size() / 100;
}

} // namespace

CleanReport clean(PointCloud& cloud, const CleanSettings& settings, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    progress.beginStage("clean");
    CleanReport report;
    report.hadNormals = cloud.hasNormals();
    report.statistics = measure(cloud, &progress);
    const bool fillSolid = report.statistics.fillSolid;
    const bool judged = cloud.size() >= kJudgedFrom;
    if (judged && settings.dropOutliers) {
        const auto outliers = findOutliers(cloud, report.statistics, &progress);
        dropPoints(cloud, outliers);
        report.outliers = outliers.size();
    }
    if (seeToNormals(cloud, judged, settings, report, progress))
        report.statistics = measure(cloud, &progress); // noise is told by normals
    if (report.estimateNeighbors) {
        // Normals that come from the positions know nothing that these do not say; but two sheets
        // that they are of are no solid.
        PointStatistics& s = report.statistics;
        s.normalNoise = 0;
        s.fillSolid = fillSolid && s.noise > kOfSheet * s.spacing;
    }
    if (settings.flipNormals) flipNormals(cloud);
    report.inward = pointsInward(cloud);
    return report;
}

} // namespace mpuvdb
