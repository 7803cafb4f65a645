// Random numbers that depend on (seed, stream, index) alone, whatever the number of threads.
#pragma once
#include <mpuvdb/vec.h>

#include <cmath>
#include <cstdint>

namespace mpuvdb
{

/// A bijection of 64 bits that lets every bit of the input reach every bit of the output.
inline std::uint64_t mixBits(std::uint64_t x)
{
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
    return x ^ (x >> 31);
}

/// Purposes of random numbers; their streams are independent of each other.
enum class RandomStream : std::uint64_t { Lines, Noise, Outliers, OutlierChoice, Holes };

/// A sequence of its own for every (seed, stream, index). [Steele14: SplitMix]
class CounterRandom
{
public:
    CounterRandom(std::uint64_t seed, RandomStream stream, std::uint64_t index)
        : mState(mixBits(mixBits(mixBits(seed + kStep) + (std::uint64_t(stream) + 1) * kStep) +
                         index * kStep))
    {
    }

    std::uint64_t next() { return mixBits(mState += kStep); }
    /// Uniform in [0,1).
    double uniform() { return double(next() >> 11) * 0x1p-53; }
    /// Standard normal. [Box58]
    double normal()
    {
        const double radius = std::sqrt(-2 * std::log(1 - uniform()));
        return radius * std::cos(2 * M_PI * uniform());
    }
    /// Three independent normal().
    Vec3d normalVector()
    {
        const double x = normal(), y = normal(), z = normal();
        return {x, y, z};
    }
    /// Uniform on the unit sphere.
    Vec3d direction()
    {
        const double z = 2 * uniform() - 1, angle = 2 * M_PI * uniform();
        const double radius = std::sqrt(std::max(0.0, 1 - z * z));
        return {radius * std::cos(angle), radius * std::sin(angle), z};
    }

private:
    /// Increment of the state, 2^64 over the golden ratio. [paper: Steele14]
    static constexpr std::uint64_t kStep = 0x9e3779b97f4a7c15u;
    std::uint64_t mState;
};

/// Two unit vectors at right angles to the unit vector @a n and to each other, as columns.
inline Eigen::Matrix<double, 3, 2> tangents(const Vec3d& n)
{
    // [Duff17]: no branch on the axis, no loss of precision near the pole.
    const double sign = std::copysign(1.0, n.z());
    const double a = -1 / (sign + n.z()), b = n.x() * n.y() * a;
    Eigen::Matrix<double, 3, 2> t;
    t.col(0) = Vec3d(1 + sign * n.x() * n.x() * a, sign * b, -sign * n.x());
    t.col(1) = Vec3d(b, sign + n.y() * n.y() * a, -n.y());
    return t;
}

} // namespace mpuvdb
