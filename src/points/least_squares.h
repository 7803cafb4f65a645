// Linear least squares.
#pragma once
#include <Eigen/Core>

namespace mpuvdb
{

/// The x that solves @a a x = @a b by least squares, column by column of @a b. One function serves
/// matrices of all sizes, as compiling a decomposition for each takes long.
Eigen::MatrixXd leastSquares(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);

} // namespace mpuvdb
