#include <mpuvdb/shape.h>

#include "shape_plan.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <fmt/format.h>

namespace mpuvdb
{

Shape::Shape(FieldPtr field, std::string name) : mNode(fieldNode(std::move(field), std::move(name)))
{
}

Shape::Shape(LevelSet levelSet, std::string name)
    : mNode(gridNode(std::move(levelSet), std::move(name)))
{
}

Shape::Shape(std::shared_ptr<const Mesh> mesh, std::string name)
    : mNode(meshNode(std::move(mesh), std::nullopt, std::move(name)))
{
}

Shape::Shape(std::shared_ptr<const Mesh> mesh, const RepairSettings& repair, std::string name)
    : mNode(meshNode(std::move(mesh), repair, std::move(name)))
{
}

Shape Shape::combine(Boolean kind, std::vector<Shape> shapes, double blendRadius)
{
    std::vector<std::shared_ptr<const Node>> inputs;
    inputs.reserve(shapes.size());
    for (Shape& shape : shapes) inputs.push_back(std::move(shape.mNode));
    return Shape(combineNode(kind, inputs, blendRadius));
}

Shape operator|(const Shape& a, const Shape& b)
{
    return Shape::combine(Boolean::Union, {a, b});
}

Shape operator&(const Shape& a, const Shape& b)
{
    return Shape::combine(Boolean::Intersection, {a, b});
}

Shape operator-(const Shape& a, const Shape& b)
{
    return Shape::combine(Boolean::Difference, {a, b});
}

Shape Shape::offset(double distance) const
{
    return Shape(offsetNode(mNode, distance));
}

Shape Shape::shell(double thickness, Wall wall) const
{
    return Shape(shellNode(mNode, thickness, wall));
}

Shape Shape::smooth(const SmoothSettings& settings) const
{
    return Shape(smoothNode(mNode, settings));
}

Shape Shape::moved(const Eigen::Affine3d& motion) const
{
    if (!motion.matrix().allFinite() || motion.linear().determinant() == 0)
        throw UsageError("motion: it is not finite, or flattens space, and has no inverse. Scale "
                         "by numbers other than 0");
    Node::Moved done;
    return Shape(mNode->moved(motion, done));
}

Shape Shape::warped(const std::shared_ptr<const Warp>& warp, const std::string& name) const
{
    Node::Moved done;
    return Shape(mNode->warped(warp, name, done));
}

Shape Shape::morph(const Shape& a, const Shape& b, double t, Morphing how)
{
    return Shape(morphNode(a.mNode, b.mNode, t, how));
}

Box3d Shape::bounds() const
{
    return mNode->bounds();
}

double Shape::voxelSize() const
{
    return mNode->voxelSize();
}

FieldPtr Shape::field() const
{
    return mNode->field();
}

std::vector<PlanStep> Shape::plan(const ShapeSettings& settings) const
{
    return ShapePlan(*mNode, settings).steps();
}

std::string Shape::explain(const ShapeSettings& settings) const
{
    const ShapePlan plan(*mNode, settings);
    std::string text;
    for (const PlanStep& step : plan.steps()) {
        const std::string what = std::string(std::size_t(2 * step.depth), ' ') + step.what;
        if (step.shared)
            text += fmt::format("{:<40} as above\n", what);
        else if (step.region.isEmpty())
            text += fmt::format("{:<40} not needed: too far away\n", what);
        else
            text += fmt::format("{:<40} band {:.1f} vx of {:.4g}, {:.3g} M voxels, {:.1f} MB\n",
                                what, step.halfWidth, step.voxelSize, double(step.voxels) / 1e6,
                                double(step.bytes) / 1e6);
    }
    text += fmt::format("{:<40} {:.1f} MB at the same time, at most\n", "together",
                        double(plan.peakBytes()) / 1e6);
    return text;
}

std::uint64_t Shape::peakBytes(const ShapeSettings& settings) const
{
    return ShapePlan(*mNode, settings).peakBytes();
}

void Shape::requireFewVoxels(const ShapeSettings& settings) const
{
    ShapePlan(*mNode, settings).requireFewVoxels();
}

void Shape::requireMemory(const ShapeSettings& settings) const
{
    ShapePlan(*mNode, settings).requireMemory();
}

LevelSet Shape::evaluate(const ShapeSettings& settings, Interrupter* interrupter) const
{
    const ShapePlan plan(*mNode, settings);
    plan.requireMemory();
    return plan.evaluate(orSilent(interrupter));
}

} // namespace mpuvdb
