// Inner nodes of shapes that are moved or deformed.
#include "shape_node.h"

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <limits>

namespace mpuvdb
{
namespace
{

using Node = Shape::Node;

/// The input's grid, sampled through a motion or a warp of space.
class ThroughNode : public Node
{
public:
    using Node::Node;

    double workingBytes(const Request& own) const override
    {
        return isRigid() ? 0 : distanceBytes(area(own.region), own.lattice.voxelSize);
    }

    LevelSet make(const Inputs& inputs, const Request& own, std::uint64_t maxBytes,
                  Interrupter& progress) const override
    {
        if (!inputs[0]) return emptyLevelSet(own.lattice, own.halfWidth);
        SampleSettings settings;
        settings.lattice = own.lattice;
        settings.halfWidth = sampledWidth(own);
        settings.maxBytes = maxBytes;
        settings.mayBeEmpty = true;
        settings.name = inputs[0]->grid().getName();
        const LevelSet sampled =
            sampleField(*through(makeGridField(*inputs[0])), settings, &progress);
        return inBand(sampled, own.halfWidth, progress);
    }

protected:
    virtual FieldPtr through(FieldPtr field) const = 0;
    /// The largest factor by which the inverse lengthens.
    virtual double stretch() const = 0;
    /// Whether distances remain distances, but for a factor.
    virtual bool isRigid() const { return false; }

    /// The whole input on voxels of @a voxelSize, as far as it is sampled.
    Request wholeInput(const Request& own, double voxelSize) const
    {
        constexpr double kStencil = 2; // voxels that interpolation reads beyond [derived: cubic]
        const Box3d& box = inputs()[0]->bounds();
        if (box.isEmpty()) return {own.lattice, own.halfWidth, box};
        // Where a part of the box, though perhaps none of the solid, is stretched without end.
        if (!std::isfinite(stretch()))
            return {latticeFor(box, voxelSize), kMaxInputBand + kStencil, box};
        const double band = sampledWidth(own) * own.lattice.voxelSize * stretch();
        return {latticeFor(box, voxelSize), band / voxelSize + kStencil, box};
    }

private:
    /// The widest band of the input, and the narrowest of this node, voxels.
    /// [tuned: plan_bench; warp_test]
    static constexpr double kMaxInputBand = 30, kMinBand = 2;

    /// The half-width that is sampled, voxels. Under much stretch a narrow band takes a wide one of
    /// the input: the rest is measured from the surface.
    double sampledWidth(const Request& own) const
    {
        if (isRigid()) return own.halfWidth;
        return std::min(own.halfWidth, std::max(kMaxInputBand / stretch(), kMinBand));
    }
};

class MotionNode final : public ThroughNode
{
public:
    MotionNode(const Ptr& input, const Eigen::Affine3d& motion)
        : ThroughNode("transform", {input}, movedBox(input->bounds(), motion)), mMotion(motion)
    {
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> squares;
        squares.computeDirect(motion.linear().transpose() * motion.linear(),
                              Eigen::EigenvaluesOnly);
        mGrowth = std::sqrt(squares.eigenvalues()[2]);
        mShrink = std::sqrt(squares.eigenvalues()[0]);
        mAreaGrowth = std::sqrt(squares.eigenvalues()[1] * squares.eigenvalues()[2]);
    }

    Request requestOf(std::size_t, const Request& own) const override
    {
        return wholeInput(own, own.lattice.voxelSize / mGrowth);
    }
    double area(const Box3d& region) const override
    {
        return mAreaGrowth * Node::area(movedBox(region, mMotion.inverse()));
    }
    double voxelSize() const override { return mGrowth * inputs()[0]->voxelSize(); }

protected:
    double stretch() const override { return 1 / mShrink; }
    bool isRigid() const override { return uniformScale(mMotion) > 0; }
    FieldPtr through(FieldPtr field) const override
    {
        return makeMovedField(std::move(field), mMotion);
    }
    Ptr movedSelf(const Eigen::Affine3d& motion, Moved&) const override
    {
        return motionNode(inputs()[0], motion * mMotion);
    }

private:
    Eigen::Affine3d mMotion;
    double mGrowth, mShrink; ///< largest and smallest factor of lengths
    double mAreaGrowth;      ///< largest factor of areas
};

class WarpNode final : public ThroughNode
{
public:
    WarpNode(const Ptr& input, std::shared_ptr<const Warp> warp, std::string name)
        : ThroughNode(std::move(name), {input},
                      input->bounds().isEmpty() ? Box3d() : warp->image(input->bounds())),
          mWarp(std::move(warp)), mStretch(stretchOver(input->bounds()))
    {
    }

    Request requestOf(std::size_t, const Request& own) const override
    {
        return wholeInput(own, own.lattice.voxelSize);
    }
    double area(const Box3d&) const override { return Node::area(inputs()[0]->bounds()); }

protected:
    double stretch() const override { return mStretch; }
    FieldPtr through(FieldPtr field) const override
    {
        return makeWarpedField(std::move(field), mWarp);
    }

private:
    /// The stretch where @a box is moved to. The image of the whole may hold the center of a bend,
    /// or both ends of a taper; those of its parts do not.
    double stretchOver(const Box3d& box) const
    {
        // Parts along a side of the box. [derived: those of a bar as thick as a bend's radius end
        // well before the center]
        constexpr int kPartsPerSide = 16;
        constexpr double kLittle = 2; ///< not worth a closer look [free: time]
        if (box.isEmpty()) return 1;
        const double whole = mWarp->stretch(bounds());
        if (whole <= kLittle || !isFinite(box)) return whole;
        const Vec3d size = box.sizes() / kPartsPerSide;
        double most = 1;
        for (int x = 0; x < kPartsPerSide; ++x)
            for (int y = 0; y < kPartsPerSide; ++y)
                for (int z = 0; z < kPartsPerSide; ++z) {
                    const Vec3d low = box.min() + size.cwiseProduct(Vec3d(x, y, z));
                    most = std::max(most, mWarp->stretch(mWarp->image(Box3d(low, low + size))));
                }
        return std::min(whole, most);
    }

    std::shared_ptr<const Warp> mWarp;
    double mStretch;
};

} // namespace

Node::Ptr warpNode(const Node::Ptr& input, std::shared_ptr<const Warp> warp, std::string name)
{
    return std::make_shared<WarpNode>(input, std::move(warp), std::move(name));
}

Node::Ptr motionNode(const Node::Ptr& input, const Eigen::Affine3d& motion)
{
    return std::make_shared<MotionNode>(input, motion);
}

Box3d movedBox(const Box3d& box, const Eigen::Affine3d& motion)
{
    constexpr double kInfinity = std::numeric_limits<double>::infinity(); // [derived: unbounded]
    if (box.isEmpty()) return box;
    if (!isFinite(box)) return {Vec3d::Constant(-kInfinity), Vec3d::Constant(kInfinity)};
    Box3d image;
    for (int corner = 0; corner < 8; ++corner)
        image.extend(motion * box.corner(Box3d::CornerType(corner)));
    return image;
}

double uniformScale(const Eigen::Affine3d& motion)
{
    const Eigen::Matrix3d& m = motion.linear();
    const double square = m.squaredNorm() / 3;
    const bool uniform =
        (m.transpose() * m - square * Eigen::Matrix3d::Identity()).norm() <= 1e-9 * square;
    return uniform ? std::sqrt(square) : 0;
}

} // namespace mpuvdb
