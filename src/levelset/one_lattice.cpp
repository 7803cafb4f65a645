#include <mpuvdb/operations.h>

#include <algorithm>

namespace mpuvdb
{
namespace
{

/// Voxel sizes pass through files as text or floats; lattices so near drift apart by less than a
/// hundredth of a voxel over ten thousand.
constexpr double kSameSize = 1e-6;
/// Voxels by which origins may differ.
constexpr double kSameOrigin = 1e-4;

bool isSame(const Lattice& a, const Lattice& b)
{
    return std::abs(a.voxelSize - b.voxelSize) <= kSameSize * b.voxelSize &&
           (a.origin - b.origin).cwiseAbs().maxCoeff() <= kSameOrigin * b.voxelSize;
}

} // namespace

OneLattice onOneLattice(const std::vector<LevelSet>& inputs, Progress& progress)
{
    OneLattice result;
    if (inputs.empty()) return result;
    const auto finest =
        std::min_element(inputs.begin(), inputs.end(), [](const LevelSet& a, const LevelSet& b) {
            return a.voxelSize() < b.voxelSize() * (1 - kSameSize);
        });
    const Lattice lattice = finest->lattice();
    result.model = std::size_t(finest - inputs.begin());
    for (std::size_t n = 0; n < inputs.size(); ++n) {
        const LevelSet& input = inputs[n];
        if (isSame(input.lattice(), lattice)) {
            result.levelSets.push_back(input);
            continue;
        }
        result.levelSets.push_back(resample(input, lattice, input.halfWidth(), progress));
        result.resampled.push_back(n);
    }
    return result;
}

} // namespace mpuvdb
