// Attributes of points, blended on the surface.
#pragma once
#include "moment_tree.h"
#include <mpuvdb/surface_attributes.h>

#include <memory>
#include <tbb/enumerable_thread_specific.h>

namespace mpuvdb
{

class Interrupter;

/// Attributes by the rule of MpuField::attributes().
class PointAttributes final : public SurfaceAttributes
{
public:
    /// @param points  have to outlive this. @param frame  world position of their origin.
    /// @throws UsageError for names that the points do not have, Interrupted.
    PointAttributes(const SortedPoints& points, const Vec3d& frame,
                    const std::vector<std::string>& names, Interrupter& progress);
    ~PointAttributes() override;

    bool hasColors() const override { return mNamed.hasColors; }
    const std::vector<std::string>& scalarNames() const override { return mNamed.scalarNames; }
    void evaluate(const std::vector<SurfacePlace>& places,
                  std::vector<float>& values) const override;

private:
    class Blender;
    struct Named {
        bool hasColors = false;
        std::vector<std::string> scalarNames;
        MomentTree::Channels channels;
    };
    static Named find(const SortedPoints& points, const std::vector<std::string>& names);

    Vec3d mFrame;
    Named mNamed;
    MomentTree mPoints;
    /// One for each thread that has evaluated, to keep its memory.
    mutable tbb::enumerable_thread_specific<std::unique_ptr<Blender>> mBlenders;
};

} // namespace mpuvdb
