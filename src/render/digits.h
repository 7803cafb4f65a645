// The digits of numbers as pixels, for pictures.
#pragma once
#include <functional>
#include <string>

namespace mpuvdb
{

constexpr int kDigitWidth = 5, kDigitHeight = 7; ///< pixels [free: the font]

/// Width of @a text, pixels: digits and the space between them.
int textWidth(const std::string& text);
/// Call fill(column, row) for the dark pixels of @a text, rows downward: of the characters
/// 0 to 9, minus, plus, point and e. Others are blank.
void drawDigits(const std::string& text, const std::function<void(int, int)>& fill);

} // namespace mpuvdb
