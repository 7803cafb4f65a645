// The distances of a leaf, and how far they are wanted.
#pragma once
#include <cstdint>
#include <limits>

namespace mpuvdb
{

/// The distance that nothing is known of. [derived: the type]
constexpr float kInfinity = std::numeric_limits<float>::infinity();

/// Distances from the surface up to which values are computed, voxels; 0: not on that side.
struct Reach {
    float outside = 0, inside = 0;
};

constexpr std::uint32_t kNoPatch =
    ~std::uint32_t(0); ///< number of no patch [derived: type's largest]

/// Signed distances of a leaf's voxels, in voxels; +-infinity beyond the reach. Computed on demand.
/// For one thread.
class LeafDistances
{
public:
    virtual ~LeafDistances() = default;
    virtual float at(int voxel) const = 0;
    /// A cheap bound of at(): of the same sign, and not nearer to zero.
    virtual float atMost(int voxel) const = 0;
    /// Number of the patch with the nearest foot; kNoPatch beyond the reach.
    virtual std::uint32_t patch(int voxel) const = 0;
};

} // namespace mpuvdb
