// Quadrics, and the local fits made of up to four.
#pragma once
#include <mpuvdb/vec.h>

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>

namespace mpuvdb
{

/// Q(y) = y^T A y + b^T y + c about some origin; y = x - origin. Negative inside.
struct Quadric {
    Eigen::Matrix3d A = Eigen::Matrix3d::Zero(); ///< symmetric
    Vec3d b = Vec3d::Zero();
    double c = 0;

    double value(const Vec3d& y) const { return y.dot(A * y) + b.dot(y) + c; }
    Vec3d gradient(const Vec3d& y) const { return 2 * (A * y) + b; }
    /// This function about another origin: newOrigin = origin + shift.
    Quadric shifted(const Vec3d& shift) const
    {
        return {A, Vec3d(b + 2 * (A * shift)), value(shift)};
    }
};

/// The piece in effect, of @a count of an edge or corner, where piece k has @a valueOf(k).
///
/// Pieces are folded from the last to the first: Q = p[n-1]; then for k = n-2 .. 0
/// Q = (bit k of maxBits) ? max(p[k], Q) : min(p[k], Q). Every tree of Ricci's Booleans of the
/// paper's edges and corners is one bit per step.
template <typename ValueOf>
int rulingPiece(int count, unsigned maxBits, const ValueOf& valueOf)
{
    int best = count - 1;
    if (best == 0) return best;
    double value = valueOf(best);
    for (int k = best - 1; k >= 0; --k) {
        const double other = valueOf(k);
        if ((maxBits >> k) & 1u ? other > value : other < value) {
            best = k;
            value = other;
        }
    }
    return best;
}

/// A quadric, or an edge or corner of up to four [Ohtake03 §4c], about one origin.
struct LocalFit {
    static constexpr int kMaxPieces = 4; ///< pieces of a corner, at most [paper: Ohtake03 §4c]

    std::array<Quadric, kMaxPieces> pieces;
    int count = 1;
    unsigned maxBits = 0; ///< see rulingPiece()

    bool isMax(int k) const { return (maxBits >> k) & 1u; }
    bool isSharp() const { return count > 1; }
    /// The piece in effect at y.
    const Quadric& ruling(const Vec3d& y) const
    {
        const auto valueOf = [&](int k) { return pieces[std::size_t(k)].value(y); };
        return pieces[std::size_t(rulingPiece(count, maxBits, valueOf))];
    }
};

/// The partition's weight at |x-c| = t R / 1.5: the quadratic B-spline of support 1.5
/// [Ohtake03 eq. 3]. T is a number or a SIMD vector; branch-free.
template <typename T>
[[gnu::always_inline]] inline T bsplineWeight(const T& t)
{
    const T fromEnd = 1.5f - t, fromKnot = 0.5f - t;
    const T outer = fromEnd > 0 ? fromEnd : T{};
    const T inner = fromKnot > 0 ? fromKnot : T{};
    return 0.5f * outer * outer - 1.5f * inner * inner;
}

/// The weight of interpolation from the inverse of the distance to the ball's center, singular
/// there: ((R - d)+ / (R d))^2 [Ohtake03 eq. 4]. T is a number or a SIMD vector.
template <typename T, typename Scalar>
[[gnu::always_inline]] inline T singularWeight(const T& inverseDistance, Scalar inverseRadius)
{
    const T w = inverseDistance - inverseRadius;
    const T within = w > 0 ? w : T{};
    return within * within;
}

} // namespace mpuvdb
