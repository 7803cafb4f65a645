// What points have beside their places, blended on the surface.
#pragma once
#include "bucket_tree.h"

#include <mpuvdb/surface_attributes.h>

namespace mpuvdb
{

/// The rule stands with MpuField::attributes().
class PointAttributes final : public SurfaceAttributes
{
public:
    /// @param points  have to outlive this. @param frame  world position of their origin.
    /// @throws UsageError for names that the points have not.
    PointAttributes(const SortedPoints& points, const Vec3d& frame,
                    const std::vector<std::string>& names);

    bool hasColors() const override { return mHasColors; }
    const std::vector<std::string>& scalarNames() const override { return mScalarNames; }
    void evaluate(const std::vector<SurfacePlace>& places,
                  std::vector<float>& values) const override;

private:
    class Neighbourhood;

    const PointBatch& mPoints;
    Vec3d mFrame;
    BucketTree mTree;
    std::vector<Eigen::AlignedBox3f> mNormals; ///< boxes about the normals of the tree's nodes
    bool mHasColors = false;
    std::vector<std::string> mScalarNames;
    std::vector<const float*> mChannels;
};

} // namespace mpuvdb
