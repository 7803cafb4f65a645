// Inner nodes of shapes: Booleans, offsets, filters, morphs.
#include "grid/band_limits.h"
#include "modelling/combine.h"
#include "modelling/half_widths.h"
#include "modelling/smooth_filters.h"
#include "shape_node.h"

#include <mpuvdb/error.h>

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <unordered_set>

namespace mpuvdb
{
namespace
{

using Node = Shape::Node;

/// An empty level set.
LevelSet nothing(const Request& own)
{
    return emptyLevelSet(own.lattice, own.halfWidth);
}

/// @a own with another region.
Request within(const Request& own, const Box3d& region)
{
    return {own.lattice, own.halfWidth, region};
}

/// The request to an input whose surface is @a distance from the result's. Beyond the widest band
/// that leaves are sampled in, offsets continue distances themselves.
Request beyond(const Request& own, double distance)
{
    const double halfWidth = own.halfWidth + distance / own.lattice.voxelSize;
    return {own.lattice, std::min(halfWidth, std::max(own.halfWidth, kMaxSampledBand)),
            grown(own.region, distance)};
}

class CombineNode final : public Node
{
public:
    CombineNode(Boolean kind, const std::vector<Ptr>& inputs, double blendRadius)
        : Node(nameOf(kind, blendRadius), inputs, boundsOf(kind, inputs, blendRadius)), mKind(kind),
          mBlendRadius(blendRadius)
    {
    }

    Request requestOf(std::size_t, const Request& own) const override
    {
        requireBandForBlend(mBlendRadius, own.lattice.voxelSize, own.halfWidth);
        if (mBlendRadius > 0)
            requireBallForSolids(mBlendRadius, own.lattice.voxelSize, boundsOfInputs());
        return own;
    }

    double workingBytes(const Request& own) const override
    {
        if (!(mBlendRadius > 0)) return 0;
        // The surfaces that the ball touches, and where its center is then.
        return distanceBytes(Node::area(own.region), own.lattice.voxelSize);
    }

    FieldPtr field() const override
    {
        if (mBlendRadius > 0) return nullptr;
        std::vector<FieldPtr> fields;
        for (const Ptr& input : inputs()) {
            fields.push_back(input->field());
            if (!fields.back()) return nullptr;
        }
        return booleanField(mKind, std::move(fields), bounds());
    }

    LevelSet make(const Inputs& inputs, const Request& own, std::uint64_t,
                  Interrupter& progress) const override
    {
        std::vector<LevelSet> solids;
        for (const LevelSet* input : inputs)
            if (input) solids.push_back(*input);
        const bool missing = solids.size() < inputs.size();
        if (solids.empty() || (mKind == Boolean::Intersection && missing) ||
            (mKind == Boolean::Difference && !inputs.front()))
            return nothing(own);
        if (solids.size() == 1) return inBand(solids.front(), own.halfWidth, progress);
        return combineInBand(mKind, solids, mBlendRadius, own.halfWidth, progress);
    }

    /// Whether it is a Boolean of that kind with no blend.
    bool is(Boolean kind) const { return mKind == kind && !(mBlendRadius > 0); }

protected:
    Ptr movedSelf(const Eigen::Affine3d& motion, Moved& done) const override
    {
        const double scale = uniformScale(motion);
        if (scale == 0 && mBlendRadius > 0) return nullptr;
        std::vector<Ptr> inputs;
        for (const Ptr& input : this->inputs()) inputs.push_back(input->moved(motion, done));
        return combineNode(mKind, inputs, mBlendRadius * scale);
    }
    Ptr warpedSelf(const std::shared_ptr<const Warp>& warp, const std::string& how,
                   Moved& done) const override
    {
        if (mBlendRadius > 0) return nullptr;
        // Unbounded inputs cannot be warped by themselves; a bounded whole can.
        for (const Ptr& input : this->inputs())
            if (!input->bounds().isEmpty() && !isFinite(input->bounds())) return nullptr;
        std::vector<Ptr> inputs;
        for (const Ptr& input : this->inputs()) inputs.push_back(input->warped(warp, how, done));
        return combineNode(mKind, inputs, 0);
    }

private:
    static std::string nameOf(Boolean kind, double blendRadius)
    {
        const char* name = kind == Boolean::Union          ? "union"
                           : kind == Boolean::Intersection ? "intersection"
                                                           : "difference";
        return blendRadius > 0 ? fmt::format("{}, blend {:.4g}", name, blendRadius) : name;
    }

    /// The box of the result: a fillet stays within the solids' hull, hence in their box.
    static Box3d boundsOf(Boolean kind, const std::vector<Ptr>& inputs, double blendRadius)
    {
        if (inputs.empty()) throw UsageError("Boolean: there is no shape. Give at least one");
        requireBlendRadius(blendRadius);
        Box3d box = inputs.front()->bounds();
        for (const Ptr& input : inputs) {
            if (kind == Boolean::Union) box.extend(input->bounds());
            if (kind == Boolean::Intersection) box = box.intersection(input->bounds());
        }
        return box;
    }

    Box3d boundsOfInputs() const
    {
        Box3d box;
        for (const Ptr& input : inputs()) box.extend(input->bounds());
        return box;
    }

    Boolean mKind;
    double mBlendRadius;
};

/// @a inputs of a Boolean without blends, with the inputs of Booleans among them that go on with
/// the same: a solid that a loop makes of itself and one more is one Boolean of many, not as many
/// Booleans one within the other. What is there twice counts once.
std::vector<Node::Ptr> joined(Boolean kind, const std::vector<Node::Ptr>& inputs)
{
    const bool isDifference = kind == Boolean::Difference;
    std::vector<Node::Ptr> all;
    std::unordered_set<const Node*> seen;
    const auto add = [&](const Node::Ptr& input) {
        const bool isMinuend = isDifference && all.empty();
        if (isMinuend || seen.insert(input.get()).second) all.push_back(input);
    };
    for (const Node::Ptr& input : inputs) {
        const Boolean same = isDifference && !all.empty() ? Boolean::Union : kind;
        const auto* const inner = dynamic_cast<const CombineNode*>(input.get());
        if (inner && inner->is(same))
            for (const Node::Ptr& one : inner->inputs()) add(one);
        else
            add(input);
    }
    return all;
}

class OffsetNode final : public Node
{
public:
    OffsetNode(const Ptr& input, double distance)
        : Node(fmt::format("offset {:.4g}", distance), {input}, grown(input->bounds(), distance)),
          mDistance(distance)
    {
        if (!std::isfinite(distance))
            throw UsageError(fmt::format("offset: distance is {}; it must be finite", distance));
    }

    Request requestOf(std::size_t, const Request& own) const override
    {
        return beyond(own, std::abs(mDistance));
    }
    double area(const Box3d& region) const override
    {
        return offsetArea(Node::area(grown(region, std::abs(mDistance))), mDistance);
    }
    double workingBytes(const Request& own) const override
    {
        const Box3d region = grown(own.region, std::abs(mDistance));
        return distanceBytes(std::max(Node::area(region), area(own.region)), own.lattice.voxelSize);
    }
    LevelSet make(const Inputs& inputs, const Request& own, std::uint64_t,
                  Interrupter& progress) const override
    {
        return inputs[0] ? inBand(mpuvdb::offset(*inputs[0], mDistance, &progress), own.halfWidth,
                                  progress)
                         : nothing(own);
    }

protected:
    Ptr movedSelf(const Eigen::Affine3d& motion, Moved& done) const override
    {
        const double scale = uniformScale(motion);
        if (scale == 0) return nullptr;
        return offsetNode(inputs()[0]->moved(motion, done), mDistance * scale);
    }

private:
    double mDistance;
};

class ShellNode final : public Node
{
public:
    ShellNode(const Ptr& input, double thickness, Wall wall)
        : Node(fmt::format("shell {:.4g}", thickness), {input},
               grown(input->bounds(), outward(thickness, wall))),
          mThickness(thickness), mWall(wall)
    {
        if (!(thickness > 0) || !std::isfinite(thickness))
            throw UsageError(fmt::format(
                "shell: thickness is {:.6g}; it must be above 0 and finite", thickness));
    }

    Request requestOf(std::size_t, const Request& own) const override
    {
        return beyond(own, mThickness);
    }
    double area(const Box3d& region) const override
    {
        const double area = Node::area(grown(region, mThickness));
        const double outer = outward(mThickness, mWall);
        return offsetArea(area, outer) + offsetArea(area, outer - mThickness);
    }
    double workingBytes(const Request& own) const override
    {
        return distanceBytes(area(own.region), own.lattice.voxelSize);
    }
    LevelSet make(const Inputs& inputs, const Request& own, std::uint64_t,
                  Interrupter& progress) const override
    {
        return inputs[0] ? inBand(mpuvdb::shell(*inputs[0], mThickness, mWall, &progress),
                                  own.halfWidth, progress)
                         : nothing(own);
    }

protected:
    Ptr movedSelf(const Eigen::Affine3d& motion, Moved& done) const override
    {
        const double scale = uniformScale(motion);
        if (scale == 0) return nullptr;
        return shellNode(inputs()[0]->moved(motion, done), mThickness * scale, mWall);
    }

private:
    static double outward(double thickness, Wall wall)
    {
        return wall == Wall::Outward ? thickness : wall == Wall::Centered ? thickness / 2 : 0;
    }
    double mThickness;
    Wall mWall;
};

class SmoothNode final : public Node
{
public:
    SmoothNode(const Ptr& input, const SmoothSettings& settings)
        : Node("smooth", {input}, input->bounds()), mSettings(settings)
    {
        requireSmoothSettings(settings);
    }

    Request requestOf(std::size_t, const Request& own) const override
    {
        // Filters read as far as their width in each pass; a Gaussian is four passes.
        const int reach = 4 * mSettings.iterations * mSettings.width;
        return within(own, grown(own.region, reach * own.lattice.voxelSize));
    }
    double workingBytes(const Request& own) const override
    {
        // The band that a pass reads, its filtered copies, and the distances after it.
        const double h = own.lattice.voxelSize, area = Node::area(own.region);
        const FilterPass pass = nextPass(mSettings, 0);
        return kFilterCopies * gridBytes(area, h, pass.halfWidth) + distanceBytes(area, h);
    }
    LevelSet make(const Inputs& inputs, const Request& own, std::uint64_t,
                  Interrupter& progress) const override
    {
        return inputs[0] ? mpuvdb::smooth(*inputs[0], mSettings, &progress) : nothing(own);
    }

private:
    static constexpr double kFilterCopies = 3; ///< grids in a pass [derived: input and two copies]
    SmoothSettings mSettings;
};

class MorphNode final : public Node
{
public:
    MorphNode(const Ptr& a, const Ptr& b, double t, Morphing how)
        : Node(fmt::format("morph {:.4g}", t), {a, b}, a->bounds().merged(b->bounds())), mT(t),
          mHow(how)
    {
        if (!(t >= 0 && t <= 1))
            throw UsageError(fmt::format("morph: t is {}; it must be in [0, 1]", t));
    }

    /// Both inputs in full: their distance decides the band.
    Request requestOf(std::size_t n, const Request& own) const override
    {
        return within(own, inputs()[n]->bounds());
    }
    /// Memory of the bands, which are doubled until they reach each other.
    double workingBytes(const Request& own) const override
    {
        constexpr double kOvershoot = 1.5; // of doubled widths, on average [derived: 1 to 2]
        const Box3d &a = inputs()[0]->bounds(), &b = inputs()[1]->bounds();
        if (a.isEmpty() || b.isEmpty()) return 0;
        const double low = (a.min() - b.min()).cwiseAbs().maxCoeff();
        const double high = (a.max() - b.max()).cwiseAbs().maxCoeff();
        const double h = own.lattice.voxelSize, whole = area({});
        const double halfWidth = own.halfWidth + kOvershoot * std::max(low, high) / h;
        return 2 * gridBytes(whole, h, halfWidth) + distanceBytes(whole, h);
    }
    double area(const Box3d&) const override
    {
        const auto whole = [&](std::size_t n) { return inputs()[n]->area(inputs()[n]->bounds()); };
        return std::max(whole(0), whole(1));
    }
    LevelSet make(const Inputs& inputs, const Request& own, std::uint64_t,
                  Interrupter& progress) const override
    {
        const LevelSet a = inputs[0] ? *inputs[0] : nothing(own),
                       b = inputs[1] ? *inputs[1] : nothing(own);
        return mpuvdb::morph(a, b, mT, mHow, &progress);
    }

private:
    double mT;
    Morphing mHow;
};

} // namespace

double Node::area(const Box3d& region) const
{
    double area = 0;
    for (const Ptr& input : mInputs) area += input->area(region);
    return area;
}

double Node::voxelSize() const
{
    double finest = 0;
    for (const Ptr& input : mInputs) {
        const double size = input->voxelSize();
        if (size > 0 && !(finest > 0 && finest < size)) finest = size;
    }
    return finest;
}

Node::Ptr Node::moved(const Eigen::Affine3d& motion, Moved& done) const
{
    Ptr& node = done[this];
    if (!node) node = movedSelf(motion, done);
    if (!node) node = motionNode(shared_from_this(), motion);
    return node;
}

Node::Ptr Node::warped(const std::shared_ptr<const Warp>& warp, const std::string& how,
                       Moved& done) const
{
    Ptr& node = done[this];
    if (!node) node = warpedSelf(warp, how, done);
    if (!node) node = warpNode(shared_from_this(), warp, how);
    return node;
}

Node::Ptr combineNode(Boolean kind, const std::vector<Node::Ptr>& inputs, double blendRadius)
{
    return std::make_shared<CombineNode>(kind, blendRadius > 0 ? inputs : joined(kind, inputs),
                                         blendRadius);
}

Node::Ptr offsetNode(const Node::Ptr& input, double distance)
{
    return std::make_shared<OffsetNode>(input, distance);
}

Node::Ptr shellNode(const Node::Ptr& input, double thickness, Wall wall)
{
    return std::make_shared<ShellNode>(input, thickness, wall);
}

Node::Ptr smoothNode(const Node::Ptr& input, const SmoothSettings& settings)
{
    return std::make_shared<SmoothNode>(input, settings);
}

Node::Ptr morphNode(const Node::Ptr& a, const Node::Ptr& b, double t, Morphing how)
{
    return std::make_shared<MorphNode>(a, b, t, how);
}

LevelSet inBand(const LevelSet& levelSet, double halfWidth, Interrupter& progress)
{
    return std::abs(levelSet.halfWidth() - halfWidth) <= kSameHalfWidth * halfWidth
               ? levelSet
               : withHalfWidth(levelSet, halfWidth, &progress);
}

Box3d grown(const Box3d& box, double by)
{
    if (box.isEmpty()) return box;
    const Vec3d d = Vec3d::Constant(by);
    return {box.min() - d, box.max() + d};
}

} // namespace mpuvdb
