#include "point_field.h"
#include <mpuvdb/scan_sampler.h>

namespace mpuvdb
{
namespace
{

class SolidField final : public PointField
{
public:
    explicit SolidField(std::shared_ptr<const Solid> solid) : mSolid(std::move(solid)) {}

    Box3d bounds() const override { return mSolid->bounds(); }
    FieldSample evaluate(const Vec3d& p) const override
    {
        return {mSolid->distance(p), mSolid->normal(p), -1, true};
    }
    double value(const Vec3d& p) const override { return mSolid->distance(p); }
    double bound(const Vec3d& p) const override { return mSolid->bound(p); }
    bool isDistance() const override { return mSolid->isExact(); }
    bool isDistanceFar() const override { return mSolid->isExact(); }

private:
    std::shared_ptr<const Solid> mSolid;
};

} // namespace

FieldPtr makeSolidField(std::shared_ptr<const Solid> solid)
{
    return std::make_shared<SolidField>(std::move(solid));
}

} // namespace mpuvdb
