// Small least squares problems that may be underdetermined.
#pragma once
#include <mpuvdb/vec.h>

namespace mpuvdb
{

/// Factorization M = L D L^T of a small symmetric positive definite matrix: Eigen's own loops are
/// not unrolled at these sizes and take three times as long.
template <int N>
class SmallCholesky
{
public:
    [[gnu::always_inline]] explicit SmallCholesky(const Eigen::Matrix<double, N, N>& M)
    {
        double scaled[N][N]; // L D
        for (int j = 0; j < N; ++j) {
            double pivot = M(j, j);
            for (int k = 0; k < j; ++k) pivot -= mLower[j][k] * scaled[j][k];
            mInverse[j] = 1 / pivot;
            for (int i = j + 1; i < N; ++i) {
                double entry = M(i, j);
                for (int k = 0; k < j; ++k) entry -= mLower[i][k] * scaled[j][k];
                scaled[i][j] = entry;
                mLower[i][j] = entry * mInverse[j];
            }
        }
    }
    [[gnu::always_inline]] Eigen::Matrix<double, N, 1>
    solve(const Eigen::Matrix<double, N, 1>& r) const
    {
        Eigen::Matrix<double, N, 1> x = r;
        for (int i = 1; i < N; ++i)
            for (int k = 0; k < i; ++k) x[i] -= mLower[i][k] * x[k];
        for (int i = 0; i < N; ++i) x[i] *= mInverse[i];
        for (int i = N - 2; i >= 0; --i)
            for (int k = i + 1; k < N; ++k) x[i] -= mLower[k][i] * x[k];
        return x;
    }

private:
    double mLower[N][N], mInverse[N];
};

/// Solve the normal equations M x = r, M symmetric semi-definite of O(1) entries, with the ridge
/// @a ridge. Refined against M itself: directions that the points determine lose the ridge's bias
/// (factor ridge / eigenvalue per step), others stay damped. Inline, so that callers may be
/// compiled for several instruction sets.
template <int N>
[[gnu::always_inline]] inline Eigen::Matrix<double, N, 1>
solveRidged(const Eigen::Matrix<double, N, N>& M, const Eigen::Matrix<double, N, 1>& r,
            const Eigen::Matrix<double, N, 1>& ridge)
{
    Eigen::Matrix<double, N, N> damped = M;
    damped.diagonal() += ridge;
    const SmallCholesky<N> factor(damped);
    Eigen::Matrix<double, N, 1> x = factor.solve(r);
    for (int step = 0; step < 2; ++step) x += factor.solve(r - M * x);
    return x.allFinite() ? x : Eigen::Matrix<double, N, 1>::Zero();
}

} // namespace mpuvdb
