// Normals of bare points: least-squares planes, then one orientation for all of a part.
#include "core/parallel_each.h"
#include "orientation.h"
#include "outward.h"
#include "points/chosen_neighbors.h"
#include "points/clean/local_plane.h"
#include "points/indexed.h"
#include "points/least_squares.h"
#include "spatial/spanning_neighbors.h"
#include "winding_votes.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/normals.h>

#include <Eigen/Dense>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <limits>
#include <utility>

namespace mpuvdb
{
namespace
{

constexpr std::size_t kNormalGrain = 1024; // points; [free: the same normals]
/// The neighbors per plane where there is no noise. [tuned: estimate_normals_test]
constexpr double kFewestChosen = 12;
/// The height over a plane that neither noise nor curvature makes, standard deviations. [tuned:
/// estimate_normals_test]
constexpr double kThick = 3;

/// Planes and links of distinct positions.
struct PlaneGraph {
    std::vector<Vec3f> normals;
    std::vector<OrientationLink> links;
    std::uint64_t onLines = 0; ///< positions that have no plane
    std::size_t eachLinks = 0; ///< of a position; the first are those of the first position
    double noise = 0;          ///< standard deviation of the positions, world units
};

/// At an edge, the neighbors' plane averages its sides: the plane of a neighbor that lies wholly
/// on one side, and passes by the point, is taken instead where it is much thinner. Not where noise
/// makes planes thick, and thin ones are luck.
Vec3f sharpened(const std::vector<Vec3f>& positions, const std::vector<LocalPlane>& planes,
                std::uint32_t i, const std::uint32_t* linked, std::size_t links, double noise)
{
    // Ratios of variances: of another plane to the own one, and of that to the noise. [tuned:
    // estimate_normals_test]
    constexpr double kThinner = 0.1, kNoises = 9;
    const double own = planes[i].variances[0];
    if (own < kNoises * noise * noise) return planes[i].normal.cast<float>();
    const LocalPlane* best = &planes[i];
    double least = kThinner * own;
    for (std::size_t k = 0; k < links; ++k) {
        const LocalPlane& other = planes[linked[k]];
        const double height = other.height(positions[i]);
        const double squares = other.variances[0] + height * height;
        if (squares < least) {
            least = squares;
            best = &other;
        }
    }
    return best->normal.cast<float>();
}

/// Standard deviations of the positions about two planes, added.
double thicknessOf(const LocalPlane& a, const LocalPlane& b, double noise)
{
    return std::max(noise, std::sqrt(a.variances[0])) + std::max(noise, std::sqrt(b.variances[0]));
}

/// Whether the planes of two positions meet between them at less than a right angle: each position
/// lies clearly off the other's plane, on the side where it would not if the angle were obtuse.
bool meetInAnAcuteEdge(const LocalPlane& a, const LocalPlane& b, const Vec3f& onA, const Vec3f& onB,
                       double noise)
{
    const double overA = a.height(onB), overB = b.height(onA);
    return std::min(std::abs(overA), std::abs(overB)) > kThick * thicknessOf(a, b, noise) &&
           overA * overB * a.normal.dot(b.normal) < 0;
}

/// Whether two planes that are about parallel are too far apart for one sheet. Nothing lies between
/// neighbors: they then are the two sides of a wall or a gap.
bool areTwoSheets(const LocalPlane& a, const LocalPlane& b, const Vec3f& apart, double noise)
{
    // The cosine of the normals, and the height in distances. [tuned: estimate_normals_test]
    constexpr double kParallel = 0.8, kSlope = 0.4;
    const double cosine = a.normal.dot(b.normal);
    if (std::abs(cosine) < kParallel) return false;
    // On one curved sheet the two heights cancel.
    const Vec3d mean = (a.normal + std::copysign(1.0, cosine) * b.normal) / 2;
    const double height = std::abs(mean.dot(apart.cast<double>()));
    return height > kSlope * double(apart.norm()) && height > kThick * thicknessOf(a, b, noise);
}

PlaneGraph fitPlanes(const std::vector<Vec3f>& positions, std::size_t neighbors, double noise,
                     Interrupter& progress)
{
    // The nearest neighbors that are linked. [tuned: estimate_normals_test]
    constexpr std::size_t kLinks = 12;
    const std::size_t count = positions.size();
    const std::size_t links = std::min({kLinks, neighbors, count - 1});
    std::vector<std::uint32_t> linked(count * links);
    std::vector<LocalPlane> planes(count);
    const SpanningNeighbors neighborhoods(positions, std::min(neighbors, count - 1), noise);
    std::atomic<std::uint64_t> onLines{0};
    tbb::parallel_for(
        tbb::blocked_range<std::size_t>(0, count, kNormalGrain), [&](const auto& range) {
            progress.advance(double(range.size()) / double(count));
            std::vector<std::uint32_t> members;
            std::uint64_t withoutPlane = 0;
            for (std::size_t i = range.begin(); i < range.end(); ++i) {
                withoutPlane += neighborhoods.about(i, members) ? 0 : 1;
                planes[i] = sheetPlaneOf(positions, members, planeOf(positions, members), noise);
                // The point is its own nearest; distinct positions can round to the same distance.
                const auto self = std::find(members.begin(), members.end(), std::uint32_t(i));
                if (self != members.end()) members.erase(self);
                std::copy_n(members.begin(), links, linked.begin() + std::ptrdiff_t(i * links));
            }
            onLines += withoutPlane;
        });
    PlaneGraph graph;
    graph.onLines = onLines;
    graph.eachLinks = links;
    graph.noise = noise;
    graph.normals.resize(count);
    forEachParallel(count, kNormalGrain, progress, [&](std::size_t i) {
        graph.normals[i] =
            sharpened(positions, planes, std::uint32_t(i), &linked[i * links], links, noise);
    });
    graph.links.resize(linked.size());
    forEachParallel(count, kNormalGrain, progress, [&](std::size_t i) {
        for (std::size_t k = i * links; k < (i + 1) * links; ++k) {
            const std::uint32_t q = linked[k];
            const Vec3f apart = positions[q] - positions[i];
            const Vec3f &normalI = graph.normals[i], &normalQ = graph.normals[q];
            OrientationLink& link = graph.links[k];
            if (areTwoSheets(planes[i], planes[q], apart, noise) ||
                meetInAnAcuteEdge(planes[i], planes[q], positions[i], positions[q], noise)) {
                link = linkAcrossSheets(std::uint32_t(i), q, normalI, normalQ);
                continue;
            }
            link = orientationLink(std::uint32_t(i), q, apart, normalI, normalQ, float(noise));
            link.unsure |= !planes[i].isThin() || !planes[q].isThin();
        }
    });
    return graph;
}

/// Turn those of the normals that are @a turned; once more turns them back.
void turn(std::vector<Vec3f>& normals, const std::vector<char>& turned)
{
    for (std::size_t i = 0; i < normals.size(); ++i)
        if (turned[i]) normals[i] = -normals[i];
}

/// Of each position the area of the surface that is nearest to it, world units squared: of the disc
/// about its neighbors, among those that look to its side.
std::vector<float> areasOf(const std::vector<Vec3f>& positions, const PlaneGraph& graph)
{
    std::vector<float> areas(positions.size());
    const std::size_t each = graph.eachLinks;
    const auto noise = float(graph.noise);
    tbb::parallel_for(std::size_t(0), positions.size(), [&](std::size_t i) {
        float farthest2 = 0;
        int same = 0;
        for (std::size_t k = i * each; k < (i + 1) * each; ++k) {
            const std::uint32_t q = graph.links[k].a == i ? graph.links[k].b : graph.links[k].a;
            farthest2 = std::max(farthest2, (positions[q] - positions[i]).squaredNorm());
            same += graph.normals[q].dot(graph.normals[i]) > 0;
        }
        // Of a ball, a layer of points takes less than a disc. [derived: two points of it are so
        // far apart in depth, on average]
        const float depth2 = std::min(2 * noise * noise, farthest2 / 2);
        areas[i] = float(M_PI) * (farthest2 - depth2) / float(std::max(same, 1));
    });
    return areas;
}

/// Turn pieces of @a parts that look the other way than the rest, by windingVotes(): neighbors at a
/// contact or a thin rim can join bodies the wrong way round. Ends when the number fits no better,
/// even if pieces vote that were unclear before others were turned.
/// @param turned  of each position, what the graph's normals were turned by; becomes what they are.
/// @return the number of points at which the winding number is not clearly a half.
std::size_t turnByWinding(const std::vector<Vec3f>& positions,
                          const std::vector<std::uint32_t>& parts, PlaneGraph& graph,
                          std::vector<char>& turned, Interrupter& progress)
{
    const auto turnTo = [&](std::vector<char> other) {
        turn(graph.normals, turned);
        turned = std::move(other);
        turn(graph.normals, turned);
    };
    const auto turnBy = [&](const WindingVotes& votes) {
        std::vector<char> other =
            solveOrientation(votes.nodes, graph.links, progress, votes.links).turned;
        for (std::size_t i = 0; i < parts.size(); ++i)
            other[i] ^= other[votes.firstPart + parts[i]];
        turnTo(std::move(other));
    };
    WindingVotes best; // on the normals that fit best
    best.misfit = std::numeric_limits<double>::infinity();
    std::vector<char> before; // what those are turned by
    for (;;) {
        WindingVotes votes =
            windingVotes({positions, graph.normals, parts}, areasOf(positions, graph), graph.noise,
                         {graph.links, turned}, progress);
        if (votes.misfit < best.misfit) {
            best = std::move(votes);
            before = turned;
            if (best.against == 0) return best.unclosed;
            turnBy(best);
            if (best.done) return best.unclosed;
            continue;
        }
        turnTo(before);
        if (best.unclear.empty()) return best.unclosed;
        best.links.insert(best.links.end(), best.unclear.begin(), best.unclear.end());
        best.unclear.clear();
        turnBy(best);
    }
}

/// Turn the normals of each part to one side: towards the scanners, or else outward.
/// @param toScanner  of each position the unit direction to its scanner, zero without; or empty.
/// @return the number of points of which it is a guess.
std::size_t orient(const std::vector<Vec3f>& positions, const std::vector<Vec3f>& toScanner,
                   PlaneGraph& graph, Interrupter& progress)
{
    // The scanners are one node more, which is never turned.
    const auto scanners = std::uint32_t(positions.size());
    for (std::uint32_t i = 0; i < toScanner.size(); ++i) {
        if (toScanner[i] == Vec3f::Zero()) continue;
        OrientationLink seen;
        seen.vote = toScanner[i].dot(graph.normals[i]);
        seen.a = i;
        seen.b = scanners;
        graph.links.push_back(seen);
    }
    Orientation found = solveOrientation(positions.size() + 1, graph.links, progress);
    const std::vector<std::uint32_t> parts = std::move(found.parts);
    turn(graph.normals, found.turned);
    std::size_t guessed = 0;
    if (toScanner.empty()) guessed = turnByWinding(positions, parts, graph, found.turned, progress);
    std::vector<char> inward = findInwardParts({positions, graph.normals, parts}, progress);
    const std::uint32_t seen = parts[scanners];
    if (seen != scanners) inward[seen] = found.turned[scanners];
    forEachParallel(positions.size(), kNormalGrain, progress, [&](std::size_t i) {
        if (inward[parts[i]]) graph.normals[i] = -graph.normals[i];
    });
    return guessed;
}

/// For each of the @a distinct positions, which those of the cloud are at @a placeOf, the direction
/// in which the first of the viewpoints that it was seen from lies; empty where no point was seen
/// from a known one.
std::vector<Vec3f> directionsToScanners(const PointCloud& cloud, const std::vector<Vec3f>& distinct,
                                        const std::vector<std::uint32_t>& placeOf)
{
    std::vector<Vec3f> result;
    if (cloud.seenFrom.empty()) return result;
    std::vector<std::uint32_t> from(distinct.size(), PointCloud::kUnseen);
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        std::uint32_t& first = from[placeOf[i]];
        first = std::min(first, cloud.seenFrom[i]);
    }
    result.assign(from.size(), Vec3f::Zero());
    for (std::size_t i = 0; i < from.size(); ++i)
        if (from[i] != PointCloud::kUnseen) {
            const Vec3d p = cloud.frame + distinct[i].cast<double>();
            result[i] = cloud.viewpoints[from[i]].towards(p).normalized().cast<float>();
        }
    return result;
}

/// Whether all points lie within rounding of a line.
bool areOnOneLine(const std::vector<Vec3f>& positions)
{
    constexpr double kRounding = 1e-6; // of the length; [derived: floats are rounded by 6e-8]
    const auto farthestFrom = [&](const Vec3f& place) {
        return *std::max_element(positions.begin(), positions.end(),
                                 [&](const Vec3f& a, const Vec3f& b) {
                                     return (a - place).squaredNorm() < (b - place).squaredNorm();
                                 });
    };
    const Vec3f from = farthestFrom(positions.front());
    const Vec3d along = (farthestFrom(from) - from).cast<double>();
    return std::all_of(positions.begin(), positions.end(), [&](const Vec3f& p) {
        const double twiceArea = (p - from).cast<double>().cross(along).norm();
        return twiceArea <= kRounding * along.squaredNorm();
    });
}

/// How much of the heights of a point's neighbors, along its normal, a slope explains.
double explainedBySlope(const Neighborhood& n)
{
    const auto count = Eigen::Index(n.neighbors.size());
    const Vec3d up = n.normal.cast<double>(), e1 = up.unitOrthogonal(), e2 = up.cross(e1);
    Eigen::MatrixX3d across(count, 3);
    Eigen::VectorXd heights(count);
    for (Eigen::Index i = 0; i < count; ++i) {
        const Vec3d p = (n.neighbors[std::size_t(i)].position - n.center).cast<double>();
        across.row(i) << 1, p.dot(e1), p.dot(e2);
        heights[i] = p.dot(up);
    }
    const Eigen::VectorXd slope = leastSquares(across, heights);
    const double all = (heights.array() - heights.mean()).matrix().squaredNorm();
    return all > 0 ? 1 - (heights - across * slope).squaredNorm() / all : 1;
}

/// Whether what passes for sheets that look opposite ways are the steps of a single one, as depth
/// cameras make them: nearly everywhere, and not over each other, as the sides of a wall are, but
/// beside, so that a slope explains a good part of their heights.
bool areSteps(const PointCloud& cloud, const PointIndex& index, Interrupter& progress)
{
    // Points that are looked at, their neighbors, and those of these that look the opposite way.
    // [tuned: estimate_normals_test]
    constexpr std::size_t kSamples = 1000, kNeighbors = 40, kOpposite = 5;
    // The fewest points of a cloud. [tuned: estimate_normals_test; of fewer, forty are a good part
    // of the shape]
    constexpr std::size_t kFewest = 1000;
    // The share of the heights' variance. [tuned: estimate_normals_test; by chance a slope explains
    // 0.05]
    constexpr double kExplained = 0.12;
    if (cloud.size() < kFewest) return false;
    const std::vector<Vec3f> chosen = choosePositions(index, kSamples, progress);
    std::size_t layered = 0, steps = 0;
    for (const Neighborhood& n : nearestOfChosen(cloud, index, chosen, kNeighbors, progress)) {
        const auto isOpposite = [&](const Neighbor& other) {
            return other.normal.dot(n.normal) < 0;
        };
        const auto opposite = std::count_if(n.neighbors.begin(), n.neighbors.end(), isOpposite);
        if (std::size_t(opposite) < kOpposite) continue;
        ++layered;
        steps += std::size_t(explainedBySlope(n) > kExplained);
    }
    return 2 * layered > chosen.size() && 2 * steps > layered;
}

/// A ball of k neighbors is sqrt(k/pi) spacings wide: three times the noise and more.
int neighborsFor(const PointStatistics& statistics)
{
    // Neighbors: at most, and by the ratio of noise to spacing and its square. [tuned:
    // estimate_normals_test, noise_test]
    constexpr double kMost = 200, kPerSlope = 24, kPerNoise = 40;
    const double ratio = statistics.spacing > 0 ? statistics.noise / statistics.spacing : 0;
    return int(std::min(kFewestChosen + kPerSlope * ratio + kPerNoise * ratio * ratio, kMost));
}

} // namespace

EstimatedNormals estimateNormals(PointCloud& cloud, const PointIndex& index,
                                 std::optional<int> neighbors, Interrupter& progress)
{
    // Neighbors. [derived: a plane and one more; a thousand take a millisecond]
    constexpr int kFewest = 4, kMost = 1000;
    if (neighbors && (*neighbors < kFewest || *neighbors > kMost))
        throw UsageError(fmt::format("normals from {} neighbors: out of range. Give {} to {}",
                                     *neighbors, kFewest, kMost));
    std::vector<std::uint32_t> placeOf;
    const std::shared_ptr<const PointIndex> sorted = index.distinct(placeOf, progress);
    progress.check();
    PointCloud distinct;
    for (std::size_t n = 0; n < sorted->size(); ++n) distinct.positions.push_back((*sorted)[n]);
    if (distinct.size() < kFewest)
        throw InputError(fmt::format("normals need at least {} distinct points, there are {}. Give "
                                     "more points, or points with normals",
                                     kFewest, distinct.size()));
    if (areOnOneLine(distinct.positions))
        throw InputError(fmt::format("the {} points lie on a line, which has no surface: give "
                                     "points of one, or points with normals",
                                     cloud.size()));
    const std::vector<Vec3f> towardsScanner =
        directionsToScanners(cloud, distinct.positions, placeOf);
    EstimatedNormals used;
    const auto pass = [&](int count, double noise) {
        PlaneGraph graph = fitPlanes(distinct.positions, std::size_t(count), noise, progress);
        const std::size_t guessed = orient(distinct.positions, towardsScanner, graph, progress);
        distinct.normals = std::move(graph.normals);
        used = {count, graph.onLines, guessed};
    };
    // Without normals, two close sheets are one noisy one. With some, they differ; where it
    // then is noise, a second round knows how much.
    constexpr double kLittle = 0.1; // spacings; [tuned: estimate_normals_test]
    pass(neighbors.value_or(int(kFewestChosen)), 0);
    PointStatistics statistics = measure(distinct, *sorted, progress);
    if (statistics.noise <= kLittle * statistics.spacing && areSteps(distinct, *sorted, progress))
        statistics = measure(PointCloud(), *sorted, progress);
    if (statistics.noise > kLittle * statistics.spacing)
        pass(neighbors.value_or(neighborsFor(statistics)), statistics.noise);
    cloud.normals.resize(cloud.size());
    forEachParallel(cloud.size(), kNormalGrain, progress,
                    [&](std::size_t i) { cloud.normals[i] = distinct.normals[placeOf[i]]; });
    return used;
}

EstimatedNormals estimateNormals(PointCloud& cloud, std::optional<int> neighbors,
                                 Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    return estimateNormals(cloud, *indexOf(cloud, progress), neighbors, progress);
}

} // namespace mpuvdb
