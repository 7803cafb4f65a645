// Estimates of the memory and output of a run of reconstruct.
#pragma once
#include <mpuvdb/reconstruct.h>

#include <cstdint>
#include <optional>

namespace mpuvdb::command
{

/// The outputs beside the level set.
struct Extras {
    bool mesh = false, coverage = false;
};

/// The estimate of a run.
struct RunEstimate {
    ReconstructionEstimate work;
    std::uint64_t peakBytes = 0; ///< the process's largest resident set
    std::uint64_t fileBytes = 0; ///< of the .vdb file
    std::uint64_t triangles = 0; ///< of the mesh
};

/// Estimates runs with one cloud.
class RunEstimator
{
public:
    /// @param bareBytes  memory of the process before it read anything.
    RunEstimator(const PointCloud& cloud, const ReconstructSettings& settings, const Extras& extras,
                 std::uint64_t bareBytes)
        : mCloud(cloud), mSettings(settings), mExtras(extras), mBareBytes(bareBytes)
    {
    }

    RunEstimate estimate(Interrupter* interrupter) const
    {
        Interrupter& progress = orSilent(interrupter);
        return estimate(mSettings, &progress);
    }
    /// Checks the memory of the run, by an estimate only where it may be near @a maxBytes.
    /// @throws LimitError above that, with a voxel size that fits.
    void demand(std::uint64_t maxBytes, Interrupter& progress) const;

private:
    RunEstimate estimate(const ReconstructSettings& settings, Interrupter* interrupter) const;
    std::optional<double> fittingVoxelSize(const RunEstimate& tooLarge, std::uint64_t maxBytes,
                                           Interrupter& progress) const;

    const PointCloud& mCloud;
    const ReconstructSettings& mSettings;
    Extras mExtras;
    std::uint64_t mBareBytes;
};

} // namespace mpuvdb::command
