#include "quadratic_error.h"

#include <Eigen/Eigenvalues>

namespace mpuvdb
{
namespace
{

/// Whether planes determine one @a direction alone, as most do: the dominant eigenvector by
/// power iteration, if the other eigenvalues are negligible.
bool determinesOne(const Eigen::Matrix3d& squares, double least, Vec3d& direction)
{
    /// Power iterations. [derived: kMinEigenvalue^(1 + steps) is below a float's rounding]
    constexpr int kPowerSteps = 4;
    Eigen::Index most = 0;
    if (!(squares.diagonal().maxCoeff(&most) > 0)) return false;
    Vec3d at = squares.col(most);
    for (int step = 0; step < kPowerSteps; ++step) at = squares * at;
    direction = at.normalized();
    const double value = direction.dot(squares * direction);
    // The sum of the squares of the other eigenvalues.
    return squares.squaredNorm() - value * value <= least * least * value * value;
}

} // namespace

QuadraticError::Minimum QuadraticError::minimum(double beyond, double least) const
{
    const auto nearest = [&](const Vec3d& place) -> Vec3d {
        return place.cwiseMax(-beyond).cwiseMin(1 + beyond);
    };
    Eigen::Array3i open = Eigen::Array3i::Ones();
    Minimum found = solve(open, mMean, least);
    // A minimum outside is moved to the wall that it exceeds most, and found again along it.
    for (int round = 0; round < 2; ++round) {
        const Vec3d held = nearest(found.place);
        Eigen::Index axis = 0;
        if ((held - found.place).cwiseAbs().maxCoeff(&axis) <= 0) break;
        open[axis] = 0;
        found.place = solve(open, held, least).place;
    }
    found.place = nearest(found.place);
    return found;
}

QuadraticError::Minimum QuadraticError::solve(const Eigen::Array3i& open, const Vec3d& at,
                                              double least) const
{
    const Vec3d mask = open.cast<double>().matrix();
    const Vec3d held = (Vec3d::Ones() - mask).cwiseProduct(at - mMean);
    const Eigen::Matrix3d squares = mask.asDiagonal() * mSquares * mask.asDiagonal();
    const Vec3d right = mask.asDiagonal() * (mRight - mSquares * held);
    Minimum found{mMean + held, Eigen::Matrix3d::Zero(), 0};
    if (Vec3d only; determinesOne(squares, least, only)) {
        const double value = only.dot(squares * only);
        found.place += mask.asDiagonal() * only * (only.dot(right) / value);
        found.free = Eigen::Matrix3d::Identity() - only * only.transpose();
        found.rank = 1;
        return found;
    }
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
    solver.computeDirect(squares);
    for (int n = 0; n < 3; ++n) {
        const double value = solver.eigenvalues()[n];
        const Vec3d direction = solver.eigenvectors().col(n);
        if (value > least * solver.eigenvalues()[2]) {
            found.place += mask.asDiagonal() * direction * (direction.dot(right) / value);
            ++found.rank;
        } else {
            found.free += direction * direction.transpose();
        }
    }
    return found;
}

} // namespace mpuvdb
