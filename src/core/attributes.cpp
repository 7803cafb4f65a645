#include <mpuvdb/attributes.h>

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

/// Linear light of an sRGB component in [0,1] [IEC 61966-2-1].
float linearOf(double encoded)
{
    return float(encoded <= 0.04045 ? encoded / 12.92 : std::pow((encoded + 0.055) / 1.055, 2.4));
}

} // namespace

Vec3f linearColor(const Rgb& rgb)
{
    static const std::array<float, 256> table = [] {
        std::array<float, 256> values{};
        for (std::size_t i = 0; i < values.size(); ++i) values[i] = linearOf(double(i) / 255);
        return values;
    }();
    return {table[rgb[0]], table[rgb[1]], table[rgb[2]]};
}

Rgb srgbColor(const Vec3f& linear)
{
    Rgb rgb{};
    for (std::size_t c = 0; c < rgb.size(); ++c) {
        // Written so that NaN is black.
        const double v = linear[int(c)] > 0 ? std::min(double(linear[int(c)]), 1.0) : 0.0;
        const double encoded = v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1 / 2.4) - 0.055;
        rgb[c] = std::uint8_t(255 * encoded + 0.5);
    }
    return rgb;
}

} // namespace mpuvdb
