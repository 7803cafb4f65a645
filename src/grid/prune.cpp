#include "prune.h"

#include <algorithm>
#include <openvdb/tree/NodeManager.h>

namespace mpuvdb
{
namespace
{

using openvdb::FloatTree;

bool isNegative(float value)
{
    return value < 0;
}

bool isOfOneSign(const FloatTree::LeafNodeType& leaf)
{
    const float* const first = leaf.buffer().data();
    const auto inside = std::count_if(first, first + FloatTree::LeafNodeType::SIZE, isNegative);
    return inside == 0 || inside == FloatTree::LeafNodeType::SIZE;
}

/// @param node  without children
template <typename Node>
bool isOfOneSign(const Node& node)
{
    const bool inside = isNegative(node.getFirstValue());
    for (auto tile = node.cbeginValueAll(); tile; ++tile)
        if (isNegative(*tile) != inside) return false;
    return true;
}

/// Prunes the children of a node; called bottom-up.
class PruneChildren
{
public:
    explicit PruneChildren(float background) : mBackground(background) {}

    void operator()(FloatTree::RootNodeType& root) const
    {
        for (auto child = root.beginChildOn(); child; ++child)
            if (isEmpty(*child)) root.addTile(child.getCoord(), tile(*child), false);
        root.eraseBackgroundTiles();
    }

    template <typename Node>
    void operator()(Node& node) const
    {
        for (auto child = node.beginChildOn(); child; ++child)
            if (isEmpty(*child)) node.addTile(child.pos(), tile(*child), false);
    }

private:
    template <typename Node>
    static bool isEmpty(const Node& node)
    {
        return node.isInactive() && isOfOneSign(node);
    }

    template <typename Node>
    float tile(const Node& node) const
    {
        return isNegative(node.getFirstValue()) ? -mBackground : mBackground;
    }

    float mBackground;
};

} // namespace

void pruneBand(FloatTree& tree)
{
    tree.clearAllAccessors();
    openvdb::tree::NodeManager<FloatTree, FloatTree::DEPTH - 2> nodes(tree);
    nodes.foreachBottomUp(PruneChildren(tree.background()));
}

} // namespace mpuvdb
