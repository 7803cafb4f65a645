// Booleans of fields by minimum and maximum: exact on the zero set, creases included.
#include "shape_node.h"

#include "field/point_field.h"

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
    FieldSample evaluate(const Vec3d& p) const override { return sample(p, mFields); }
    std::unique_ptr<PointEvaluator> evaluator(double spacing) const override
    {
        return std::make_unique<Evaluator>(*this, spacing);
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
    class Evaluator final : public PointEvaluator
    {
    public:
        Evaluator(const BooleanField& field, double spacing) : mField(field)
        {
            for (const FieldPtr& from : field.mFields) mFrom.push_back(from->evaluator(spacing));
        }
        FieldSample evaluate(const Vec3d& p) override { return mField.sample(p, mFrom); }

    private:
        const BooleanField& mField;
        std::vector<std::unique_ptr<PointEvaluator>> mFrom;
    };

    /// @param from  the fields, or their evaluators.
    template <typename From>
    FieldSample sample(const Vec3d& p, const From& from) const
    {
        FieldSample ruling = from.front()->evaluate(p);
        for (std::size_t n = 1; n < from.size(); ++n) {
            FieldSample other = from[n]->evaluate(p);
            if (mKind == Boolean::Difference) {
                other.value = -other.value;
                other.gradient = -other.gradient;
            }
            const bool isLess = other.value < ruling.value;
            if (isLess == (mKind == Boolean::Union)) ruling = other;
        }
        return ruling;
    }

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
