// What points and vertices have beside their places: colors and named numbers.
#pragma once
#include <mpuvdb/vec.h>

#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace mpuvdb
{

/// Numbers with a name, one per point or vertex.
struct NamedScalars {
    std::string name;
    std::vector<float> values;
};

/// A color as files of points have it: red, green and blue in the sRGB curve.
using Rgb = std::array<std::uint8_t, 3>;

/// Linear light in [0,1], which can be blended, of an sRGB color.
Vec3f linearColor(const Rgb& rgb);
/// The nearest sRGB color; components outside of [0,1] are clamped.
Rgb srgbColor(const Vec3f& linear);

} // namespace mpuvdb
