// Attributes of points and vertices: colors and named scalars.
#pragma once
#include <mpuvdb/vec.h>

#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace mpuvdb
{

/// Scalars with a name, one per point or vertex.
struct NamedScalars {
    std::string name;
    std::vector<float> values;
};

/// A color as point files have it: red, green and blue, sRGB.
using Rgb = std::array<std::uint8_t, 3>;

/// The linear light of an sRGB color, in [0,1]: linear colors can be blended.
Vec3f linearColor(const Rgb& rgb);
/// The nearest sRGB color of linear light; components outside of [0,1] are clamped, NaN is 0.
Rgb srgbColor(const Vec3f& linear);

} // namespace mpuvdb
