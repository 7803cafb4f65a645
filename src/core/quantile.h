// Quantiles.
#pragma once
#include <algorithm>
#include <cstddef>
#include <vector>

namespace mpuvdb
{

/// The value that a share of @a values, in [0,1], does not exceed; they are not empty, and are
/// reordered.
template <class T>
T quantile(std::vector<T>& values, double share)
{
    const auto at = values.begin() + std::ptrdiff_t(share * double(values.size() - 1));
    std::nth_element(values.begin(), at, values.end());
    return *at;
}

} // namespace mpuvdb
