// The first rows of a plain text file, whose values tell what its columns are.
#pragma once
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace mpuvdb
{

/// Rows of the same length.
using SampleRows = std::vector<std::vector<double>>;

inline bool isWhole(double v)
{
    return v == std::floor(v);
}

/// Whether f holds for the three values from @a column on in at least 95 % of the rows; never where
/// there are fewer.
template <class F>
bool mostTriples(const SampleRows& rows, std::size_t column, const F& f)
{
    if (column + 3 > rows.front().size()) return false;
    const auto good = std::count_if(rows.begin(), rows.end(),
                                    [&](const auto& row) { return f(row.data() + column); });
    return 20 * std::size_t(good) >= 19 * rows.size();
}

/// Whether these three are vectors of unit length, as normals are.
inline bool areUnit(const SampleRows& rows, std::size_t column)
{
    return mostTriples(rows, column, [](const double* t) {
        return std::abs(t[0] * t[0] + t[1] * t[1] + t[2] * t[2] - 1) < 0.1;
    });
}

} // namespace mpuvdb
