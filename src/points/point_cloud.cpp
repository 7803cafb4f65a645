#include <mpuvdb/point_cloud.h>

namespace mpuvdb
{

Box3d PointCloud::localBounds() const
{
    Box3d box;
    for (const Vec3f& p : positions) box.extend(p.cast<double>());
    return box;
}

} // namespace mpuvdb
