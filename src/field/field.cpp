#include <mpuvdb/field.h>

namespace mpuvdb
{
namespace
{

class Forwarding final : public PointEvaluator
{
public:
    explicit Forwarding(const Field& field) : mField(field) {}
    FieldSample evaluate(const Vec3d& position) override { return mField.evaluate(position); }

private:
    const Field& mField;
};

} // namespace

std::unique_ptr<PointEvaluator> Field::evaluator(double) const
{
    return std::make_unique<Forwarding>(*this);
}

} // namespace mpuvdb
