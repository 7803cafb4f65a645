// What is done to points before they are fitted: outliers go, normals are estimated or put right.
#pragma once
#include <mpuvdb/point_cloud.h>

#include <cstdint>
#include <optional>
#include <string>

namespace mpuvdb
{

/// Where normals come from.
enum class NormalsFrom {
    Auto,    ///< the points', what is flipped among them turned; estimated where there are none
    Keep,    ///< the points', as they are; estimated where there are none
    Estimate ///< always estimated
};

struct CleanSettings {
    NormalsFrom normals = NormalsFrom::Auto;
    bool dropOutliers = true;
    bool flipNormals = false; ///< turn all normals round, at last
};

/// What clean() found and did.
struct CleanReport {
    PointStatistics statistics;           ///< of the points as they are now
    std::uint64_t outliers = 0;           ///< points left out
    std::uint64_t flipped = 0;            ///< normals turned
    bool hadNormals = false;              ///< before
    std::optional<int> estimateNeighbors; ///< points per plane where normals were estimated
    double onLines = 0;  ///< share of the points whose neighbors all lie on a line, if estimated
    double unclosed = 0; ///< share of the points that are not of a closed solid, if normals were
                         ///< estimated without viewpoints
    std::uint64_t turned = 0; ///< normals of closed parts that looked inward as a whole, and were
                              ///< turned
    bool inward = false;      ///< normals point inward, so that inside and outside are exchanged

    /// Whether so many normals have no plane to go by that surfaces will be wrong.
    bool guessesNormals() const
    {
        /// Share of all points that wires and twigs beside a surface do not reach. [tuned: none of
        /// ten real files has so many, lines too far apart (LinesTooFarApartAreSaid) nearly all]
        constexpr double kMaxOnLines = 0.05;
        return onLines > kMaxOnLines;
    }
    /// A warning where so much is so thin, for the points' spacing or the noise of points without
    /// normals, that its sides will be confused; else empty.
    std::string tooThin() const;
    /// Whether which side is outside is a guess: for most points no solid tells.
    bool guessesOutside() const { return unclosed > 0.5; }
};

/// Leave out outliers, and see to the normals; the points come out in Morton order. Fewer than 1000
/// points say little of each other: they all stay, and so do their normals, but for those of closed
/// parts that look inward: turned are all of these together, see findInwardSolids(), unless
/// flipNormals decides. Normals of points whose viewpoints are known stay, too.
/// @throws InputError for too few points, Interrupted.
CleanReport clean(PointCloud& cloud, const CleanSettings& settings,
                  Interrupter* interrupter = nullptr);

} // namespace mpuvdb
