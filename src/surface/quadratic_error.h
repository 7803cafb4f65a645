// Where planes meet in a cell.
#pragma once
#include <mpuvdb/vec.h>

#include <Eigen/Core>

namespace mpuvdb
{

/// Smallest eigenvalue, relative to the largest, of a direction that planes determine. Two planes
/// with angle t between their normals have the ratio tan^2(t/2): folds below 20 degrees are
/// smoothed. [tuned: sharp_mesh_test]
constexpr double kMinEigenvalue = 0.03;

/// Quadratic error function of planes [Ju02]: its minimum is the place of least weighted squared
/// distance from planes, in or near the unit cube, and of such places the nearest to the mean.
class QuadraticError
{
public:
    struct Minimum {
        Vec3d place;
        Eigen::Matrix3d free; ///< projects onto the directions that the planes leave free
        int rank;             ///< number of directions that they determine
    };

    explicit QuadraticError(const Vec3d& mean) : mMean(mean) {}

    void add(const Vec3d& normal, const Vec3d& point, double weight)
    {
        mSquares += weight * normal * normal.transpose();
        mRight += weight * normal * normal.dot(point - mMean);
    }

    /// @param beyond  largest distance outside the cube. @param least  smallest eigenvalue,
    /// relative to the largest, of a direction that the planes determine.
    Minimum minimum(double beyond, double least) const;

private:
    /// The minimum over the open coordinates; the others are those of @a at.
    Minimum solve(const Eigen::Array3i& open, const Vec3d& at, double least) const;

    Vec3d mMean;
    Eigen::Matrix3d mSquares = Eigen::Matrix3d::Zero();
    Vec3d mRight = Vec3d::Zero();
};

} // namespace mpuvdb
