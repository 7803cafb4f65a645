// Lengths as users write them: "0.002" (world units), "1.5vx" (voxels), "0.1%" (of the diagonal).
#pragma once
#include <string>
#include <string_view>

namespace mpuvdb
{

/// A length with its unit, resolved once voxel size and bounding box are known.
struct Length {
    enum class Unit { World, Voxels, Percent };

    double value = 0;
    Unit unit = Unit::World;

    /// Parse a length. @param text  a number, optionally followed by "vx" or "%".
    /// @throws UsageError if @a text is anything else, or not finite.
    static Length parse(std::string_view text);
    /// The length in world units. @param voxelSize  world units per voxel. @param diagonal  length
    /// of the diagonal of the input's bounding box, world units.
    double resolve(double voxelSize, double diagonal) const;
    /// The length as parse() reads it.
    std::string text() const;
};

} // namespace mpuvdb
