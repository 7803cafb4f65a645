#include <mpuvdb/operations.h>

#include <fmt/format.h>

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

std::vector<LevelSet> onOneLattice(const std::vector<LevelSet>& inputs,
                                   std::vector<std::string>& notes, Progress& progress)
{
    if (inputs.empty()) return {};
    const auto finest =
        std::min_element(inputs.begin(), inputs.end(), [](const LevelSet& a, const LevelSet& b) {
            return a.voxelSize() < b.voxelSize() * (1 - kSameSize);
        });
    const Lattice lattice = finest->lattice();
    std::vector<LevelSet> result;
    for (const LevelSet& input : inputs) {
        if (isSame(input.lattice(), lattice)) {
            result.push_back(input);
            continue;
        }
        result.push_back(resample(input, lattice, input.halfWidth(), progress));
        notes.push_back(fmt::format("'{}' (voxel size {:g}) was resampled to the lattice of '{}' "
                                    "(voxel size {:g})",
                                    input.grid().getName(), input.voxelSize(),
                                    finest->grid().getName(), lattice.voxelSize));
    }
    return result;
}

} // namespace mpuvdb
