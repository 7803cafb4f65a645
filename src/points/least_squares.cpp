#include "least_squares.h"

#include <Eigen/QR>

namespace mpuvdb
{

Eigen::MatrixXd leastSquares(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b)
{
    const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> decomposition(a);
    Eigen::MatrixXd x(a.cols(), b.cols());
    for (Eigen::Index i = 0; i < b.cols(); ++i)
        x.col(i) = decomposition.solve(Eigen::VectorXd(b.col(i)));
    return x;
}

} // namespace mpuvdb
