// How far a noisy surface may be averaged: the radius of least estimated risk, place by place.
#pragma once
#include "mpu/octree/mean_pyramid.h"
#include "sheet.h"

#include <array>
#include <optional>
#include <vector>

namespace mpuvdb
{

/// Parts of a ball's radius that cells of means in it are wide. [tuned: noise_bench; 5 costs 2 %]
constexpr double kMeansPerRadius = 7;

/// Start of a sheet's growth in its last radius. [tuned: noise_bench]
constexpr double kStart = 0.3;

/// Points of a place and around, at hand for fits of one radius after the other.
class PointGatherer
{
public:
    PointGatherer(const MeanPyramid& pyramid, const RootCube& root) : mPyramid(pyramid), mRoot(root)
    {
    }
    /// Set @a out to the points or means about @a center, relative to it, that a sheet of @a radius
    /// may be of.
    void gather(const Vec3d& center, double radius, const PointNoise& noise, CellPoints& out);
    /// Set @a out to the points within @a radius of @a center.
    void gatherPoints(const Vec3d& center, double radius, CellPoints& out);

private:
    void gatherFrom(const SortedPoints& points, const Vec3d& center, double radius,
                    CellPoints& out);

    const MeanPyramid& mPyramid;
    const RootCube& mRoot;
    BatchFilter mFilter;
    PointBatch mBatch;
};

/// Largest number of radii that are tried at a place. [tuned: noise_bench]
constexpr int kMostRadii = 16;

/// Estimates of fits of growing radius at a place: squared bias and variance, both in sigma
/// squared.
struct Risk {
    std::array<float, kMostRadii> bias2{}, variance{};
    int steps = 0; ///< fits that were made
};

/// The radius of least risk at probes spread over a cloud. A fit of a larger radius has a smaller
/// variance, which its covariance tells, and a larger bias, which the differences between fits of
/// nested radii show beyond their variance [Lepski91]; both are averaged over neighboring probes.
class RadiusMap
{
public:
    /// @param spacing  of the points, world units. The same for any number of threads.
    /// @throws Interrupted.
    RadiusMap(const MeanPyramid& pyramid, const RootCube& root, const PointNoise& noise,
              double spacing, Interrupter& progress);

    /// The map that save() wrote to @a file, mapped. @throws InputError.
    RadiusMap(const ArrayFile& file, const RootCube& root);
    /// @throws IoError.
    void save(ArrayFileWriter& file) const;

    /// The radius at @a place, world units, from the probes around it; none where there are none.
    std::optional<double> at(const Vec3d& place) const;
    /// The noise at @a place.
    PointNoise noiseAt(const Vec3d& place) const;
    /// at() for a sheet there whose normal is @a normal: probes of sheets that face elsewhere do
    /// not count, unless there are no others.
    std::optional<double> at(const Vec3d& place, const Vec3d& normal) const;

private:
    /// A place on the surface, and ln of the radius there.
    struct Probe {
        std::uint64_t key; ///< Morton key of its cell
        Vec3d place;
        Vec3d normal = Vec3d::Zero();
        double logRadius = 0, logSigma = 0;
    };
    /// How probably two probes are on one sheet, in [0, 1]: where their normals agree, and neither
    /// is far above or below the other.
    static double likeness(const Probe& a, const Probe& b);
    template <typename WeightOf>
    std::optional<double> average(const Vec3d& place, double Probe::*log,
                                  const WeightOf& weightOf) const;
    PointNoise noiseOf(const Probe& probe) const;
    void placeProbes(const SortedPoints& points);
    double stepAt(std::size_t n, const std::vector<Risk>& risks) const;
    void measureSigma(const std::vector<NoiseSums>& residuals);
    void measureTangential(const std::vector<NoiseSums>& residuals);
    template <typename F>
    void forEachNear(const Vec3d& place, const F& f) const;

    RootCube mRoot;
    PointNoise mNoise;           ///< of the whole cloud
    int mLevel = 0;              ///< of the probes' cells
    std::vector<Probe> mProbes;  ///< by key, as they are made
    StoredArray<Probe> mSettled; ///< they in the end
};

} // namespace mpuvdb
