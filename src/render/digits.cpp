#include "digits.h"

#include <array>
#include <cstdint>

namespace mpuvdb
{
namespace
{

constexpr int kSpace = 1; ///< between characters, pixels [free: the font]

/// The rows of a character, their leftmost pixel in the highest bit.
struct Glyph {
    char character;
    std::array<std::uint8_t, kDigitHeight> rows;
};

constexpr Glyph kGlyphs[] = {
    {'0', {0b01110, 0b10001, 0b10011, 0b10101, 0b11001, 0b10001, 0b01110}},
    {'1', {0b00100, 0b01100, 0b00100, 0b00100, 0b00100, 0b00100, 0b01110}},
    {'2', {0b01110, 0b10001, 0b00001, 0b00110, 0b01000, 0b10000, 0b11111}},
    {'3', {0b01110, 0b10001, 0b00001, 0b00110, 0b00001, 0b10001, 0b01110}},
    {'4', {0b00010, 0b00110, 0b01010, 0b10010, 0b11111, 0b00010, 0b00010}},
    {'5', {0b11111, 0b10000, 0b11110, 0b00001, 0b00001, 0b10001, 0b01110}},
    {'6', {0b01110, 0b10000, 0b10000, 0b11110, 0b10001, 0b10001, 0b01110}},
    {'7', {0b11111, 0b00001, 0b00010, 0b00100, 0b00100, 0b01000, 0b01000}},
    {'8', {0b01110, 0b10001, 0b10001, 0b01110, 0b10001, 0b10001, 0b01110}},
    {'9', {0b01110, 0b10001, 0b10001, 0b01111, 0b00001, 0b00001, 0b01110}},
    {'-', {0b00000, 0b00000, 0b00000, 0b01110, 0b00000, 0b00000, 0b00000}},
    {'+', {0b00000, 0b00100, 0b00100, 0b11111, 0b00100, 0b00100, 0b00000}},
    {'.', {0b00000, 0b00000, 0b00000, 0b00000, 0b00000, 0b00100, 0b00100}},
    {'e', {0b00000, 0b00000, 0b01110, 0b10001, 0b11111, 0b10000, 0b01110}},
};

} // namespace

int textWidth(const std::string& text)
{
    return int(text.size()) * (kDigitWidth + kSpace) - (text.empty() ? 0 : kSpace);
}

void drawDigits(const std::string& text, const std::function<void(int, int)>& fill)
{
    for (std::size_t n = 0; n < text.size(); ++n)
        for (const Glyph& glyph : kGlyphs) {
            if (glyph.character != text[n]) continue;
            for (int row = 0; row < kDigitHeight; ++row)
                for (int column = 0; column < kDigitWidth; ++column)
                    if (glyph.rows[std::size_t(row)] >> (kDigitWidth - 1 - column) & 1)
                        fill(int(n) * (kDigitWidth + kSpace) + column, row);
        }
}

} // namespace mpuvdb
