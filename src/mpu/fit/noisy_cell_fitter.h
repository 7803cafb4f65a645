// The decision about a cell among noisy points: how large it is, and how many sheets it holds.
#pragma once
#include "local_fit.h"
#include "radius_map.h"

namespace mpuvdb
{

struct MpuSettings;

/// What fits of noisy points need of the whole cloud.
struct NoisyScan {
    std::size_t minPoints = 0; ///< least points of a sheet
    std::unique_ptr<const MeanPyramid> pyramid;
    std::unique_ptr<const RadiusMap> radii;

    /// Memory of the means, bytes per point. [derived: cells of the finest level are up to a
    /// spacing wide, and those above add a third; noise splits some of their normals into two
    /// clusters: up to 1.6 means per point, of eight floats, key and table]
    static constexpr std::uint64_t kMeanBytes = 80;
    /// Whether fits by @a settings average their points.
    static bool isFor(const MpuSettings& settings);
    /// @return null where the noise is below what a fit to the tolerance resolves anyway.
    static std::unique_ptr<const NoisyScan> of(const SortedPoints& points, const RootCube& root,
                                               const MpuSettings& settings, Interrupter& progress);
    /// The scan of @a points that save() wrote to @a file, mapped. @throws InputError.
    static std::unique_ptr<const NoisyScan> open(const SortedPoints& points, const ArrayFile& file,
                                                 const RootCube& root);
    /// @throws IoError.
    void save(ArrayFileWriter& file) const;
};

/// Fits the sheets of cells, with the scratch memory of one thread.
class NoisyCellFitter
{
public:
    NoisyCellFitter(const NoisyScan& scan, const RootCube& root, bool sharp)
        : mScan(scan), mSharp(sharp), mGatherer(*scan.pyramid, root)
    {
    }

    /// Whether a ball of @a radius about @a center is too large for one fit.
    bool isTooLarge(const Vec3d& center, double radius) const;
    /// Fit the sheets of @a ball, the points within @a radius of @a center; others around it
    /// count by how probably they are of the same sheets. @return whether there is any sheet.
    bool fit(const CellPoints& ball, const Vec3d& center, double radius, LocalFit& result);
    /// Support by data of the last fit, @a result, in a ball about @a center (relative to the last
    /// one's): 1 where its zero set lies among the points, 0 where it is extrapolated far.
    double support(const LocalFit& result, const Vec3d& center, double radius) const;
    /// Whether so many points of the last fit's ball are improbable that other sheets would pay.
    bool leavesSheets(const LocalFit& result, double radius) const;

private:
    void growSheets(const CellPoints& ball, const Vec3d& center, double radius);

    const NoisyScan& mScan;
    bool mSharp;
    PointNoise mNoise; ///< where the last cell is
    PointGatherer mGatherer;
    CellPoints mAround, mScratch, mEvidence;
    std::vector<std::uint8_t> mTaken;
    std::vector<Sheet> mSheets;
};

} // namespace mpuvdb
