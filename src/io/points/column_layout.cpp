#include "column_layout.h"

#include "sample_rows.h"

namespace mpuvdb
{
namespace
{

/// Whether three columns hold whole numbers from 0 to @a largest.
bool areWhole(const SampleRows& rows, std::size_t first, double largest)
{
    return mostTriples(rows, first, [=](const double* t) {
        return std::all_of(t, t + 3,
                           [=](double v) { return isWhole(v) && v >= 0 && v <= largest; });
    });
}

bool areFractions(const SampleRows& rows, std::size_t first)
{
    return mostTriples(rows, first, [](const double* t) {
        return std::all_of(t, t + 3, [](double v) { return v >= 0 && v <= 1; });
    });
}

void assign(ColumnLayout& layout, std::size_t first, Attribute attribute)
{
    for (std::size_t i = 0; i < 3; ++i)
        layout.columns[first + i] = Attribute(std::size_t(attribute) + i);
}

} // namespace

ColumnLayout layoutFromValues(const SampleRows& rows, ColumnOrder order,
                              const std::vector<Attribute>& leading)
{
    if (!leading.empty()) {
        SampleRows behind;
        for (const auto& row : rows)
            behind.emplace_back(row.begin() + std::ptrdiff_t(leading.size()), row.end());
        ColumnLayout layout = layoutFromValues(behind, order, {});
        layout.columns.insert(layout.columns.begin(), leading.begin(), leading.end());
        return layout;
    }
    ColumnLayout layout;
    layout.columns.assign(rows.front().size(), Attribute::None);
    assign(layout, 0, Attribute::X);
    const std::size_t columns = layout.columns.size();
    // Before them there may be an intensity, a color, or both.
    for (const std::size_t first : {3UL, 4UL, 6UL, 7UL})
        if (areUnit(rows, first)) {
            assign(layout, first, Attribute::NormalX);
            break;
        }
    const auto isFree = [&](std::size_t first) {
        return first + 3 <= columns && layout.columns[first] == Attribute::None &&
               layout.columns[first + 2] == Attribute::None;
    };
    // What stands before normals or at the end.
    const auto ends = [&](std::size_t last) {
        return last == columns || layout.columns[last] == Attribute::NormalX;
    };
    // An intensity may be such a number as colors are.
    if (order == ColumnOrder::IntensityFirst && isFree(4) && ends(7) &&
        (areWhole(rows, 4, 255) || areFractions(rows, 4))) {
        assign(layout, 4, Attribute::Red);
        return layout;
    }
    for (const std::size_t first : {std::size_t(3), std::size_t(4), std::size_t(6)})
        if (isFree(first) && areWhole(rows, first, 255)) {
            assign(layout, first, Attribute::Red);
            return layout;
        }
    // Numbers of 16 bits may be something else: a color stands before normals or at the end, where
    // an intensity would make three numbers before the last one look like it.
    for (const std::size_t first : {std::size_t(3), std::size_t(4), std::size_t(6)})
        if (isFree(first) && ends(first + 3) && areWhole(rows, first, 65535)) {
            assign(layout, first, Attribute::Red);
            return layout;
        }
    // Six columns that are no such numbers: colors in [0,1], or normals that are not normalized.
    if (columns == 6 && isFree(3)) {
        assign(layout, 3, areFractions(rows, 3) ? Attribute::Red : Attribute::NormalX);
    }
    // Fractions may be anything: they are colors where they are all that positions and normals
    // leave.
    if (columns == 9 && isFree(3) != isFree(6)) {
        const std::size_t left = isFree(3) ? 3 : 6;
        if (areFractions(rows, left)) assign(layout, left, Attribute::Red);
    }
    return layout;
}

} // namespace mpuvdb
