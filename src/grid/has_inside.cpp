#include "has_inside.h"

#include <algorithm>

namespace mpuvdb
{

bool hasInside(const openvdb::FloatTree& tree)
{
    using openvdb::FloatTree;
    for (auto leaf = tree.cbeginLeaf(); leaf; ++leaf) {
        const float* const values = leaf->buffer().data();
        if (std::any_of(values, values + FloatTree::LeafNodeType::SIZE,
                        [](float v) { return v < 0; }))
            return true;
    }
    auto tile = tree.cbeginValueAll();
    for (tile.setMaxDepth(FloatTree::ValueAllCIter::LEAF_DEPTH - 1); tile; ++tile)
        if (*tile < 0) return true;
    return false;
}

} // namespace mpuvdb
