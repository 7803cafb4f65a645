#include "leaf_signs.h"

#include <openvdb/tree/NodeManager.h>

#include <map>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using openvdb::CoordBBox;

/// Gives the space between the leaves of a level set the sign of the leaves beside it, by scan
/// lines as openvdb::tools::signedFloodFill() does, which needs the leaves' voxels.
class SignFill
{
public:
    using Tree = openvdb::FloatTree;
    using Leaf = Tree::LeafNodeType;
    using Root = Tree::RootNodeType;

    SignFill(const std::vector<LeafPlace>& places, float background)
        : mPlaces(places), mBackground(background)
    {
    }

    void operator()(Leaf&) const {}
    template <typename Node>
    void operator()(Node& node) const
    {
        constexpr openvdb::Index kDim = 1 << Node::LOG2DIM; ///< children [derived: OpenVDB's]
        const auto first = node.getChildMask().findFirstOn();
        if (first >= Node::NUM_VALUES) return;
        const auto lastAt = [&](openvdb::Index at, bool otherwise) {
            return node.getChildMask().isOn(at) ? isLastInside(childAt(node, at)) : otherwise;
        };
        bool x = isFirstInside(childAt(node, first));
        for (openvdb::Index i = 0; i < kDim; ++i) {
            x = lastAt(i * kDim * kDim, x);
            bool y = x;
            for (openvdb::Index j = 0; j < kDim; ++j) {
                y = lastAt((i * kDim + j) * kDim, y);
                bool z = y;
                for (openvdb::Index k = 0; k < kDim; ++k) {
                    const openvdb::Index at = (i * kDim + j) * kDim + k;
                    z = lastAt(at, z);
                    if (node.getChildMask().isOff(at)) setTile(node, at, z);
                }
            }
        }
    }
    void operator()(Root& root) const
    {
        constexpr int kDim = int(Root::ChildNodeType::DIM); ///< voxels [derived: OpenVDB's]
        std::map<Coord, const Root::ChildNodeType*> children;
        for (auto child = root.cbeginChildOn(); child; ++child)
            children.emplace(child.getCoord(), &*child);
        const Coord* before = nullptr;
        bool inside = false;
        for (const auto& [at, child] : children) {
            if (before && inside && (*before)[0] == at[0] && (*before)[1] == at[1])
                for (Coord c = before->offsetBy(0, 0, kDim); c[2] < at[2]; c[2] += kDim)
                    root.addTile(c, -mBackground, false);
            before = &at;
            inside = isLastInside(*child);
        }
    }

private:
    template <typename Node>
    static const typename Node::ChildNodeType& childAt(const Node& node, openvdb::Index at)
    {
        return *node.getTable()[at].getChild();
    }
    template <typename Node>
    void setTile(Node& node, openvdb::Index at, bool inside) const
    {
        node.addTile(at, inside ? -mBackground : mBackground, false);
    }
    bool isFirstInside(const Leaf& leaf) const
    {
        return mPlaces[leaf.transientData()].head->firstInside != 0;
    }
    bool isLastInside(const Leaf& leaf) const
    {
        return mPlaces[leaf.transientData()].head->lastInside != 0;
    }
    template <typename Node>
    bool isFirstInside(const Node& node) const
    {
        return node.getChildMask().isOn(0) ? isFirstInside(childAt(node, 0))
                                           : node.getTable()[0].getValue() < 0;
    }
    template <typename Node>
    bool isLastInside(const Node& node) const
    {
        constexpr openvdb::Index kLast = Node::NUM_VALUES - 1; ///< child [derived: OpenVDB's]
        return node.getChildMask().isOn(kLast) ? isLastInside(childAt(node, kLast))
                                               : node.getTable()[kLast].getValue() < 0;
    }

    const std::vector<LeafPlace>& mPlaces;
    float mBackground;
};

/// Edge of a leaf and of the nodes of leaves, voxels. [derived: OpenVDB's tree]
constexpr int kLeafDim = 8, kNodeDim = 128;

/// Calls visit(voxel) with the first voxel of each block in @a box.
template <typename Visit>
void forEachBlock(const CoordBBox& box, const Visit& visit)
{
    for (int x = box.min()[0]; x <= box.max()[0]; x += kLeafDim)
        for (int y = box.min()[1]; y <= box.max()[1]; y += kLeafDim)
            for (int z = box.min()[2]; z <= box.max()[2]; z += kLeafDim) visit(Coord(x, y, z));
}

} // namespace

void fillSigns(openvdb::FloatTree& tree, const std::vector<LeafPlace>& places)
{
    const SignFill fill(places, tree.background());
    openvdb::tree::NodeManager<openvdb::FloatTree> nodes(tree);
    nodes.foreachBottomUp(fill);
}

BlockSigns::BlockSigns(const std::vector<LeafPlace>& leaves, const CoordBBox& box,
                       const Interrupter& progress)
    : mBox(box)
{
    for (std::size_t axis = 0; axis < 3; ++axis)
        mCount[axis] = std::size_t(box.dim()[int(axis)] / kLeafDim);
    mStates.assign(mCount[0] * mCount[1] * mCount[2], State::Unknown);
    for (const LeafPlace& leaf : leaves) mStates[at(leaf.origin())] = State::Leaf;
    std::vector<Coord> last;
    const auto spread = [&](const Coord& block, int axis, int step, State state) {
        Coord next = block;
        next[axis] += step * kLeafDim;
        if (!mBox.isInside(next)) return;
        State& there = mStates[at(next)];
        if (there != State::Unknown) return;
        there = state;
        last.push_back(next);
    };
    // Beside a leaf: all voxels of its face have one sign, as the band ends within the leaf.
    for (const LeafPlace& leaf : leaves)
        for (int axis = 0; axis < 3; ++axis)
            for (const int step : {-1, 1})
                spread(leaf.origin(), axis, step,
                       (step < 0 ? leaf.head->firstInside : leaf.head->lastInside) != 0
                           ? State::Inside
                           : State::Outside);
    for (std::size_t done = 0; !last.empty(); ++done) {
        if (done % kNodeDim == 0) progress.check();
        const Coord block = last.back();
        last.pop_back();
        for (int axis = 0; axis < 3; ++axis)
            for (const int step : {-1, 1}) spread(block, axis, step, mStates[at(block)]);
    }
}

std::size_t BlockSigns::at(const Coord& voxel) const
{
    const Coord block = voxel - mBox.min();
    return (std::size_t(block[0] / kLeafDim) * mCount[1] + std::size_t(block[1] / kLeafDim)) *
               mCount[2] +
           std::size_t(block[2] / kLeafDim);
}

bool BlockSigns::isInsideWhole(const CoordBBox& box) const
{
    bool is = true;
    forEachBlock(box, [&](const Coord& block) { is = is && isInside(block); });
    return is;
}

bool BlockSigns::hasLeaf(const CoordBBox& box) const
{
    bool has = false;
    forEachBlock(box, [&](const Coord& block) { has = has || mStates[at(block)] == State::Leaf; });
    return has;
}

void BlockSigns::fill(openvdb::FloatTree& tree, Fill what, const Interrupter& progress) const
{
    const float inside = -tree.background();
    const Coord first = mBox.min() & ~(kNodeDim - 1);
    for (int x = first[0]; x <= mBox.max()[0]; x += kNodeDim)
        for (int y = first[1]; y <= mBox.max()[1]; y += kNodeDim)
            for (int z = first[2]; z <= mBox.max()[2]; z += kNodeDim) {
                progress.check();
                const CoordBBox node = CoordBBox::createCube({x, y, z}, kNodeDim);
                CoordBBox part = node;
                part.intersect(mBox);
                if (part == node && isInsideWhole(node))
                    tree.addTile(2, node.min(), inside, false);
                else if (what == Fill::All || hasLeaf(part))
                    forEachBlock(part, [&](const Coord& block) {
                        if (isInside(block)) tree.addTile(1, block, inside, false);
                    });
            }
}

} // namespace mpuvdb
