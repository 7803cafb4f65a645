#include "histogram.h"

#include "digits.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>

namespace mpuvdb
{
namespace
{

constexpr int kWidth = 800, kHeight = 400; ///< pixels [free: a picture's size]
/// Bars, and pixels about them. [free: a picture's look]
constexpr int kBars = 76, kMargin = 20, kTick = 6;
/// Size of a font's pixel, and space above and below numbers, pixels. [free: a picture's look]
constexpr int kPixel = 2, kGap = 4;
constexpr int kBase = kHeight - 2 * kTick - 2 * kGap - kPixel * kDigitHeight; ///< of bars, pixels
constexpr int kBar = (kWidth - 2 * kMargin) / kBars; ///< pixels [derived: quotient]

std::uint8_t encode(float linear)
{
    const double v = double(std::clamp(linear, 0.0f, 1.0f));
    const double srgb = v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1 / 2.4) - 0.055;
    return std::uint8_t(std::lround(255 * srgb));
}

void fill(Image& image, int left, int top, int right, int bottom, const Vec3f& color)
{
    for (int y = std::max(top, 0); y < std::min(bottom, kHeight); ++y)
        for (int x = std::max(left, 0); x < std::min(right, kWidth); ++x)
            for (int c = 0; c < 3; ++c)
                image.rgb[std::size_t(3 * (y * kWidth + x) + c)] = encode(color[c]);
}

/// A number below the tick at @a x, as far as the picture goes.
void number(Image& image, int x, double value)
{
    const std::string text = fmt::format("{:.3g}", value);
    const int width = kPixel * textWidth(text);
    const int left = std::clamp(x - width / 2, kGap, kWidth - kGap - width);
    drawDigits(text, [&](int column, int row) {
        const int px = left + kPixel * column, py = kBase + 2 * kTick + kGap + kPixel * row;
        fill(image, px, py, px + kPixel, py + kPixel, Vec3f::Zero());
    });
}

} // namespace

Vec3f deviationColor(double deviation, double range)
{
    const auto t = float(std::clamp(deviation / range, -1.0, 1.0));
    const Vec3f white(0.9f, 0.9f, 0.9f), red(0.7f, 0.02f, 0.02f), blue(0.02f, 0.08f, 0.7f);
    return white + std::abs(t) * ((t < 0 ? blue : red) - white);
}

void writeHistogram(const std::filesystem::path& file, const std::vector<float>& values,
                    double range, Interrupter* interrupter)
{
    std::array<std::size_t, kBars> counts{};
    for (const float value : values) {
        if (!std::isfinite(value)) continue;
        const double place = (double(value) / range + 1) / 2 * kBars;
        ++counts[std::size_t(std::clamp(place, 0.0, kBars - 1.0))];
    }
    const std::size_t most =
        std::max<std::size_t>(*std::max_element(counts.begin(), counts.end()), 1);
    Image image{kWidth, kHeight, std::vector<std::uint8_t>(std::size_t(3 * kWidth * kHeight), 255)};
    for (int bar = 0; bar < kBars; ++bar) {
        const double share = double(counts[std::size_t(bar)]) / double(most);
        const int height = int(std::ceil(share * (kBase - kMargin)));
        const int left = kMargin + bar * kBar;
        const double middle = ((bar + 0.5) / kBars * 2 - 1) * range;
        // White bars stand on white paper: all have an outline of a darker color.
        const Vec3f color = deviationColor(middle, range);
        fill(image, left, kBase - height, left + kBar, kBase, 0.6f * color);
        fill(image, left + 1, kBase - height + 1, left + kBar - 1, kBase, color);
    }
    const Vec3f black = Vec3f::Zero();
    fill(image, kMargin, kBase, kWidth - kMargin, kBase + 1, black);
    for (int tick = -10; tick <= 10; ++tick) {
        const int x = kWidth / 2 + tick * (kBars * kBar / 2) / 10;
        const bool isNumbered = tick % 5 == 0;
        fill(image, x, kBase, x + 1, kBase + (isNumbered ? 2 : 1) * kTick, black);
        if (isNumbered) number(image, x, tick / 10.0 * range);
    }
    writePng(file, image, orSilent(interrupter));
}

} // namespace mpuvdb
