// The nodes of a shape's expression: each says what it needs of its inputs, and makes its grid.
#pragma once
#include "core/boxes.h"
#include "grid/band_bytes.h"
#include <mpuvdb/sampling.h>
#include <mpuvdb/shape.h>

#include <map>
#include <optional>

namespace mpuvdb
{

/// The widest band, in voxels, that leaves are sampled into: farther distances are measured from
/// the zero set. [tuned: plan_bench]
constexpr double kMaxSampledBand = 20;

/// A request to a node: values that are right within region, in a band of halfWidth voxels.
struct Request {
    Lattice lattice;
    double halfWidth = 0; ///< voxels
    Box3d region;         ///< world units; empty: nothing is requested

    double band() const { return halfWidth * lattice.voxelSize; }
};

/// The grids of a node's inputs; null where nothing was requested: all of it is outside there.
using Inputs = std::vector<const LevelSet*>;

class Shape::Node : public std::enable_shared_from_this<Shape::Node>
{
public:
    using Ptr = std::shared_ptr<const Node>;
    /// Nodes already moved or warped, by their originals, so that shared ones stay shared.
    using Moved = std::map<const Node*, Ptr>;

    Node(std::string name, std::vector<Ptr> inputs, const Box3d& bounds)
        : mName(std::move(name)), mInputs(std::move(inputs)), mBounds(bounds)
    {
    }
    virtual ~Node() = default;

    const std::string& name() const { return mName; }
    const std::vector<Ptr>& inputs() const { return mInputs; }
    const Box3d& bounds() const { return mBounds; }

    /// The request to input @a n that @a own leads to.
    virtual Request requestOf(std::size_t n, const Request& own) const = 0;
    /// The working memory for @a own, beside the grids of this node and its inputs, bytes;
    /// estimated.
    virtual double workingBytes(const Request&) const { return 0; }
    /// The area of its surface within @a region, world units squared; estimated.
    virtual double area(const Box3d& region) const;
    /// As Shape::voxelSize().
    virtual double voxelSize() const;
    /// As Shape::field().
    virtual FieldPtr field() const { return nullptr; }
    /// Makes the grid. @param maxBytes  memory limit; 0: none.
    virtual LevelSet make(const Inputs& inputs, const Request& own, std::uint64_t maxBytes,
                          Interrupter& progress) const = 0;

    /// @{ The same solid moved or deformed, by its leaves where that changes nothing else.
    Ptr moved(const Eigen::Affine3d& motion, Moved& done) const;
    Ptr warped(const std::shared_ptr<const Warp>& warp, const std::string& how, Moved& done) const;
    /// @}

    static const Ptr& of(const Shape& shape) { return shape.mNode; }
    static Shape toShape(Ptr node) { return Shape(std::move(node)); }

protected:
    /// @{ As moved() and warped(), of this node itself; null if the motion has to stay above it.
    virtual Ptr movedSelf(const Eigen::Affine3d&, Moved&) const { return nullptr; }
    virtual Ptr warpedSelf(const std::shared_ptr<const Warp>&, const std::string&, Moved&) const
    {
        return nullptr;
    }
    /// @}

private:
    std::string mName;
    std::vector<Ptr> mInputs;
    Box3d mBounds;
};

/// @{ The kinds of nodes.
Shape::Node::Ptr fieldNode(FieldPtr field, std::string name);
Shape::Node::Ptr gridNode(LevelSet levelSet, std::string name);
Shape::Node::Ptr meshNode(std::shared_ptr<const Mesh> mesh,
                          const std::optional<RepairSettings>& repair, std::string name);
Shape::Node::Ptr combineNode(Boolean kind, const std::vector<Shape::Node::Ptr>& inputs,
                             double blendRadius);
Shape::Node::Ptr offsetNode(const Shape::Node::Ptr& input, double distance);
Shape::Node::Ptr shellNode(const Shape::Node::Ptr& input, double thickness, Wall wall);
Shape::Node::Ptr smoothNode(const Shape::Node::Ptr& input, const SmoothSettings& settings);
Shape::Node::Ptr morphNode(const Shape::Node::Ptr& a, const Shape::Node::Ptr& b, double t,
                           Morphing how);
/// Motions and warps that do not reach the leaves: the input's grid is sampled through them.
Shape::Node::Ptr warpNode(const Shape::Node::Ptr& input, std::shared_ptr<const Warp> warp,
                          std::string name);
Shape::Node::Ptr motionNode(const Shape::Node::Ptr& input, const Eigen::Affine3d& motion);
/// @}

/// The Boolean of fields (at least one): no distance near creases, but exact on the zero set.
/// @param bounds  of the result.
FieldPtr booleanField(Boolean kind, std::vector<FieldPtr> fields, const Box3d& bounds);

/// @a levelSet in a band of @a halfWidth voxels: itself where its own is that wide.
LevelSet inBand(const LevelSet& levelSet, double halfWidth, Interrupter& progress);

/// The level set in @a node, if it holds one.
const LevelSet* levelSetIn(const Shape::Node& node);

/// @{ Boxes that may be empty or infinite.
Box3d grown(const Box3d& box, double by);
Box3d movedBox(const Box3d& box, const Eigen::Affine3d& motion);
/// @}

/// The factor of a motion that scales all lengths alike; 0 if it does not.
double uniformScale(const Eigen::Affine3d& motion);

} // namespace mpuvdb
