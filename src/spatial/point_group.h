// SIMD arithmetic on four points, with the same bits from every instruction set.
#pragma once
#include "unset_vector.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>

namespace mpuvdb
{

using Group = double __attribute__((vector_size(32)));

[[gnu::always_inline]] inline Group load(const UnsetVector<double>& a, std::size_t i)
{
    return Group{a[i], a[i + 1], a[i + 2], a[i + 3]};
}

[[gnu::always_inline]] inline double sum(const Group& g)
{
    return (g[0] + g[1]) + (g[2] + g[3]);
}

[[gnu::always_inline]] inline double smallest(const Group& g)
{
    return std::min(std::min(g[0], g[1]), std::min(g[2], g[3]));
}

[[gnu::always_inline]] inline double largest(const Group& g)
{
    return std::max(std::max(g[0], g[1]), std::max(g[2], g[3]));
}

[[gnu::always_inline]] inline double squareRoot(double x)
{
    return std::sqrt(x);
}

[[gnu::always_inline]] inline Group squareRoot(const Group& g)
{
    double a[4];
    std::memcpy(a, &g, sizeof g);
    for (double& v : a) v = std::sqrt(v);
    Group root;
    std::memcpy(&root, a, sizeof root);
    return root;
}

} // namespace mpuvdb
