// Points too sparse for a grid of cells, judged by their nearest neighbors.
#pragma once
#include <mpuvdb/point_cloud.h>

#include <cstddef>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// What a point's neighbors alone say of it.
struct SparsePoint {
    bool outlying = false;
    bool amongLike = false; ///< its neighbors are about as far from theirs as it is from them
    double spacing = 0;     ///< of a surface on which its neighbors would lie around it
};

/// What the first @a doubtful points of @a cloud are by their neighbors: points of groups too small
/// to be surfaces at the cells' scale, among each other and those after them, which stand for the
/// surfaces' cells. Sparse surfaces are such groups, and so are outliers. @throws Interrupted.
std::vector<SparsePoint> judgeSparsePoints(const PointCloud& cloud, std::size_t doubtful,
                                           Interrupter& progress);

} // namespace mpuvdb
