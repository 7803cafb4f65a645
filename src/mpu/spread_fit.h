// A fit that is spread over processes: what is decided from all points is made once and kept in
// files, which are mapped; parts of the octree are fitted apart from each other, and joined.
#pragma once
#include "mpu/fit/noisy_cell_fitter.h"
#include "mpu/octree/octree.h"

#include <array>
#include <cstddef>
#include <filesystem>
#include <memory>
#include <vector>

namespace mpuvdb
{

class SpreadFit
{
public:
    /// Names of the files of a plan. [derived: what plan() decides]
    static constexpr std::array<const char*, 3> kFiles = {"points.bin", "scan.bin", "upper.bin"};

    /// Sort @a cloud, measure the scan, decide the upper octree, and keep all that in @a folder.
    /// @param pointsPerPart  about how many points a part of the fit has.
    /// @throws as MpuField, and IoError.
    static void plan(const std::filesystem::path& folder, PointCloud&& cloud,
                     const MpuSettings& settings, std::size_t pointsPerPart, Interrupter& progress);

    /// Open what plan() made. @throws IoError, InputError (damaged).
    explicit SpreadFit(const std::filesystem::path& folder);

    std::size_t parts() const { return mPartEnds.size(); }
    const SortedPoints& points() const { return *mPoints; }

    /// Fit part @a n, below parts(), and write it to @a file. The same bytes whenever it is done.
    /// @throws IoError, Interrupted.
    void fit(std::size_t n, const std::filesystem::path& file, Interrupter& progress) const;
    /// Join the parts, from the files @a parts in order, with the coarse field if data are missing
    /// anywhere, in @a file. @throws IoError, InputError (damaged parts), Interrupted.
    void join(const std::vector<std::filesystem::path>& parts, const std::filesystem::path& file,
              Interrupter& progress) const;
    /// The field that join() wrote to @a file, mapped; it is the one that MpuField makes of the
    /// cloud at once. @throws IoError, InputError (damaged).
    static std::shared_ptr<const MpuField> open(const std::filesystem::path& folder,
                                                const std::filesystem::path& file);

private:
    std::vector<OctreeCell> unsupportedIn(const std::vector<std::filesystem::path>& parts) const;
    const SubtreeRoot* beginOf(std::size_t part) const
    {
        return mSubtrees.begin() + (part == 0 ? 0 : mPartEnds[part - 1]);
    }

    MpuSettings mSettings;
    Vec3d mFrame = Vec3d::Zero();
    Box3d mBounds; ///< of the points, local coordinates
    RootCube mRoot;
    std::unique_ptr<SortedPoints> mPoints;
    std::unique_ptr<const NoisyScan> mScan; ///< null where points are not averaged
    OctreeDraft mUpper;
    StoredArray<SubtreeRoot> mSubtrees;   ///< in Morton order
    StoredArray<std::uint64_t> mPartEnds; ///< number of the subtree after each part's last
};

} // namespace mpuvdb
