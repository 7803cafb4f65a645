#include "leaf_files.h"

#include "leaf_format.h"
#include "leaf_signs.h"
#include <mpuvdb/error.h>

#include <openvdb/io/Compression.h>
#include <openvdb/io/io.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <sstream>

namespace mpuvdb
{
namespace
{

using openvdb::CoordBBox;
using openvdb::GridBase;

/// Leaves compressed at a time. [free: memory]
constexpr std::size_t kBatch = 4096;

std::vector<char> headOf(const GridBase& grid)
{
    std::ostringstream out;
    openvdb::io::setVersion(out, {}, openvdb::OPENVDB_FILE_VERSION);
    const std::string type = grid.type();
    out << type << '\n';
    grid.writeMeta(out);
    grid.writeTransform(out);
    const std::string bytes = out.str();
    return {bytes.begin(), bytes.end()};
}

template <typename GridT>
void save(ArrayFileWriter& file, const std::string& prefix, const GridT& grid, const CoordBBox& box,
          const Interrupter& progress)
{
    using Leaf = typename GridT::TreeType::LeafNodeType;
    std::vector<const Leaf*> leaves;
    for (auto leaf = grid.tree().cbeginLeaf(); leaf; ++leaf)
        if (box.isInside(leaf->origin())) leaves.push_back(&*leaf);
    std::vector<LeafHead> heads(leaves.size());
    const auto background = grid.background();
    std::vector<char> bytes;
    for (std::size_t begin = 0; begin < leaves.size(); begin += kBatch) {
        const std::size_t count = std::min(kBatch, leaves.size() - begin);
        std::vector<std::string> made(count);
        tbb::parallel_for(std::size_t(0), count, [&](std::size_t n) {
            progress.check();
            LeafCompressor<Leaf> compressor(background, grid.saveFloatAsHalf());
            heads[begin + n] = compressor.add(*leaves[begin + n]);
            made[n] = compressor.take();
        });
        for (const std::string& leaf : made) bytes.insert(bytes.end(), leaf.begin(), leaf.end());
    }
    file.add(prefix + "head", headOf(grid));
    file.addValue(prefix + "background", background);
    file.add(prefix + "leaves", heads);
    file.add(prefix + "voxels", bytes);
}

using Wanted = std::function<bool(const openvdb::Coord&)>;

template <typename GridT>
void read(GridT& grid, const std::vector<ArrayFile>& files, const std::string& prefix,
          const CoordBBox& box, const Interrupter& progress, const Wanted& wanted)
{
    using Tree = typename GridT::TreeType;
    using Leaf = typename Tree::LeafNodeType;
    const auto background =
        files.front().template value<typename GridT::ValueType>(prefix + "background");
    const std::vector<LeafPlace> places = leafPlaces(files, prefix, box, progress);
    std::vector<std::unique_ptr<Leaf>> leaves(places.size());
    tbb::parallel_for(std::size_t(0), places.size(), [&](std::size_t n) {
        progress.check();
        const LeafPlace& place = places[n];
        if (wanted && !wanted(place.origin())) return;
        std::istringstream in(std::string(place.bytes, place.head->bytes));
        openvdb::io::setVersion(in, {}, openvdb::OPENVDB_FILE_VERSION);
        openvdb::io::setDataCompression(in, leafCompression());
        openvdb::io::setGridBackgroundValuePtr(in, &background);
        leaves[n] = std::make_unique<Leaf>(place.origin(), background, false);
        leaves[n]->setValueMask(place.mask<typename Leaf::NodeMaskType>());
        leaves[n]->readBuffers(in, grid.saveFloatAsHalf());
        if (!in) damagedLeaves();
    });
    auto tree = std::make_shared<Tree>(background);
    std::size_t count = 0;
    for (std::unique_ptr<Leaf>& leaf : leaves) {
        if (!leaf) continue;
        tree->addLeaf(leaf.release());
        ++count;
    }
    if (tree->leafCount() != count) damagedLeaves(); // two of one place
    if constexpr (std::is_same_v<Tree, openvdb::FloatTree>)
        if (grid.getGridClass() == openvdb::GRID_LEVEL_SET && !places.empty())
            BlockSigns(places, box, progress).fill(*tree, BlockSigns::Fill::All, progress);
    grid.setTree(tree);
}

} // namespace

void saveLeaves(ArrayFileWriter& file, const std::string& prefix, const GridBase& grid,
                const CoordBBox& box, const Interrupter& progress)
{
    if (grid.isType<openvdb::FloatGrid>())
        save(file, prefix, static_cast<const openvdb::FloatGrid&>(grid), box, progress);
    else if (grid.isType<openvdb::Vec3SGrid>())
        save(file, prefix, static_cast<const openvdb::Vec3SGrid&>(grid), box, progress);
    else
        throw UsageError("grids of " + grid.valueType() + " cannot be kept in parts");
}

GridBase::Ptr readLeaves(const std::vector<ArrayFile>& files, const std::string& prefix,
                         const CoordBBox& box, const Interrupter& progress, const Wanted& wanted)
{
    const GridBase::Ptr grid = leafGridHead(files.at(0), prefix);
    if (grid->isType<openvdb::FloatGrid>())
        read(static_cast<openvdb::FloatGrid&>(*grid), files, prefix, box, progress, wanted);
    else
        read(static_cast<openvdb::Vec3SGrid&>(*grid), files, prefix, box, progress, wanted);
    return grid;
}

bool isSpaceInside(const std::vector<ArrayFile>& files, const std::string& prefix,
                   const CoordBBox& box, const openvdb::Coord& voxel, const Interrupter& progress)
{
    return BlockSigns(leafPlaces(files, prefix, box, progress), box, progress).isInside(voxel);
}

std::vector<openvdb::Coord> nodesWithLeaves(const ArrayFile& file, const std::string& prefix,
                                            int edge)
{
    std::vector<openvdb::Coord> nodes;
    for (const LeafHead& head : file.get<LeafHead>(prefix + "leaves")) {
        const openvdb::Coord node =
            openvdb::Coord(head.origin[0], head.origin[1], head.origin[2]) & ~(edge - 1);
        if (nodes.empty() || nodes.back() != node) nodes.push_back(node);
    }
    std::sort(nodes.begin(), nodes.end());
    nodes.erase(std::unique(nodes.begin(), nodes.end()), nodes.end());
    return nodes;
}

bool hasLeaves(const ArrayFile& file, const std::string& prefix)
{
    return !file.get<LeafHead>(prefix + "leaves").empty();
}

} // namespace mpuvdb
