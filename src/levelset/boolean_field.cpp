// Several fields as one, by minimum and maximum: exact on the zero set, creases included.
#include "shape_node.h"

#include <mpuvdb/point_field.h>

#include <algorithm>

namespace mpuvdb
{
namespace
{

class BooleanField final : public PointField
{
public:
    BooleanField(Boolean kind, std::vector<FieldPtr> fields, const Box3d& bounds)
        : mKind(kind), mFields(std::move(fields)), mBounds(bounds)
    {
    }

    Box3d bounds() const override { return mBounds; }
    FieldSample evaluate(const Vec3d& p) const override
    {
        FieldSample ruling = mFields.front()->evaluate(p);
        for (std::size_t n = 1; n < mFields.size(); ++n) {
            FieldSample other = mFields[n]->evaluate(p);
            if (mKind == Boolean::Difference) {
                other.value = -other.value;
                other.gradient = -other.gradient;
            }
            const bool isLess = other.value < ruling.value;
            if (isLess == (mKind == Boolean::Union)) ruling = other;
        }
        return ruling;
    }
    double value(const Vec3d& p) const override { return evaluate(p).value; }
    bool isDistance() const override { return false; }
    double steepness() const override
    {
        double most = 0;
        for (const FieldPtr& field : mFields) most = std::max(most, field->steepness());
        return most;
    }

private:
    Boolean mKind;
    std::vector<FieldPtr> mFields;
    Box3d mBounds;
};

} // namespace

FieldPtr booleanField(Boolean kind, std::vector<FieldPtr> fields, const Box3d& bounds)
{
    return std::make_shared<BooleanField>(kind, std::move(fields), bounds);
}

} // namespace mpuvdb
