// Grids without voxels, whose leaves are copied from files as they are.
#include "leaf_files.h"
#include "leaf_format.h"
#include "leaf_signs.h"
#include <mpuvdb/error.h>

#include <openvdb/io/Compression.h>
#include <openvdb/io/DelayedLoadMetadata.h>
#include <openvdb/io/io.h>

#include <algorithm>
#include <memory>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using openvdb::CoordBBox;
using openvdb::GridBase;

/// The kind of a leaf's inactive voxels, see openvdb::io::MaskCompress.
std::int8_t kindOf(const char* bytes)
{
    return std::int8_t(bytes[kKindAt]);
}

/// Bytes of a leaf's active voxels, with their count: all but what is before them.
std::int64_t activeBytes(const LeafPlace& place, std::size_t valueBytes)
{
    using namespace openvdb::io;
    const std::int8_t kind = kindOf(place.bytes);
    const bool one = kind == NO_MASK_AND_ONE_INACTIVE_VAL || kind == MASK_AND_ONE_INACTIVE_VAL,
               two = kind == MASK_AND_TWO_INACTIVE_VALS,
               mask = kind == MASK_AND_NO_INACTIVE_VALS || kind == MASK_AND_ONE_INACTIVE_VAL || two;
    const std::size_t before = kKindAt + 1 +
                               (two   ? 2
                                : one ? 1
                                      : 0) *
                                   valueBytes +
                               (mask ? kKindAt : 0);
    return std::int64_t(place.head->bytes) - std::int64_t(before);
}

template <typename GridT>
class GridOfLeaves final : public GridT, public OfLeaves
{
public:
    using Tree = typename GridT::TreeType;
    using Leaf = typename Tree::LeafNodeType;

    GridOfLeaves(const typename Tree::Ptr& tree, std::vector<LeafPlace>&& places,
                 const Interrupter& progress)
        : GridT(tree), mPlaces(std::move(places)), mProgress(progress)
    {
    }

    void writeBuffers(std::ostream& out) const override
    {
        for (auto leaf = this->tree().cbeginLeaf(); leaf; ++leaf) {
            const LeafPlace& place = mPlaces[leaf->transientData()];
            mProgress.check();
            out.write(place.bytes, place.head->bytes);
        }
    }
    openvdb::MetaMap fileMetadata() const override
    {
        const auto copy = openvdb::ConstPtrCast<GridBase>(this->copyGrid());
        copy->addStatsMetadata();
        // As if the voxels were there: files say what reading them takes.
        const auto bytes =
            this->memUsage() + mPlaces.size() * Leaf::SIZE * sizeof(typename Leaf::ValueType);
        openvdb::io::DelayedLoadMetadata delayed;
        delayed.resizeMask(mPlaces.size());
        delayed.resizeCompressedSize(mPlaces.size());
        std::size_t n = 0;
        for (auto leaf = this->tree().cbeginLeaf(); leaf; ++leaf, ++n) {
            const LeafPlace& place = mPlaces[leaf->transientData()];
            delayed.setMask(n, kindOf(place.bytes));
            delayed.setCompressedSize(n, activeBytes(place, sizeof(typename Leaf::ValueType)));
        }
        addLeafMetadata(*copy, bytes, delayed);
        return *copy;
    }

private:
    std::vector<LeafPlace> mPlaces; ///< by the leaves' transient data
    const Interrupter& mProgress;
};

/// As LeafRegion says.
void fillSigns(openvdb::FloatTree& tree, const std::vector<LeafPlace>& places,
               const LeafRegion& region, const Interrupter& progress)
{
    constexpr int kNodeDim = 128; ///< voxels of a node's edge [derived: OpenVDB's tree]
    if (region.box == CoordBBox::inf()) {
        fillSigns(tree, places);
        return;
    }
    BlockSigns(places, region.box, progress).fill(tree, BlockSigns::Fill::Lasting, progress);
    for (const CoordBBox& box : region.inside)
        for (int x = box.min()[0]; x < box.max()[0]; x += kNodeDim)
            for (int y = box.min()[1]; y < box.max()[1]; y += kNodeDim)
                for (int z = box.min()[2]; z < box.max()[2]; z += kNodeDim) {
                    progress.check();
                    tree.addTile(2, Coord(x, y, z), -tree.background(), false);
                }
}

/// A tree of leaves without voxels. @throws InputError if two are in one place.
template <typename Tree>
typename Tree::Ptr treeOf(const std::vector<LeafPlace>& places,
                          const typename Tree::ValueType& background)
{
    using Leaf = typename Tree::LeafNodeType;
    auto tree = std::make_shared<Tree>(background);
    openvdb::tree::ValueAccessor<Tree> to(*tree);
    for (std::size_t n = 0; n < places.size(); ++n) {
        auto leaf =
            std::make_unique<Leaf>(openvdb::PartialCreate(), places[n].origin(), background, false);
        leaf->setValueMask(places[n].mask<typename Leaf::NodeMaskType>());
        leaf->setTransientData(openvdb::Index32(n));
        to.addLeaf(leaf.release());
    }
    if (tree->leafCount() != places.size()) damagedLeaves();
    return tree;
}

template <typename GridT>
GridBase::Ptr joined(const GridT& head, const std::vector<ArrayFile>& files,
                     const std::string& prefix, const LeafRegion& region,
                     const Interrupter& progress)
{
    using Tree = typename GridT::TreeType;
    const auto background =
        files.front().template value<typename GridT::ValueType>(prefix + "background");
    std::vector<LeafPlace> places = leafPlaces(files, prefix, region.box, progress);
    const auto tree = treeOf<Tree>(places, background);
    if constexpr (std::is_same_v<Tree, openvdb::FloatTree>)
        if (head.getGridClass() == openvdb::GRID_LEVEL_SET)
            fillSigns(*tree, places, region, progress);
    const openvdb::SharedPtr<GridT> grid(
        new GridOfLeaves<GridT>(tree, std::move(places), progress));
    grid->insertMeta(head);
    grid->setTransform(head.transform().copy());
    return grid;
}

} // namespace

GridBase::Ptr gridOfLeaves(const std::vector<ArrayFile>& files, const std::string& prefix,
                           const LeafRegion& region, const Interrupter& progress)
{
    if (files.empty()) throw InputError("there are no parts of a grid");
    const GridBase::Ptr head = leafGridHead(files.front(), prefix);
    if (head->isType<openvdb::FloatGrid>())
        return joined(static_cast<const openvdb::FloatGrid&>(*head), files, prefix, region,
                      progress);
    return joined(static_cast<const openvdb::Vec3SGrid&>(*head), files, prefix, region, progress);
}

void addLeafMetadata(openvdb::MetaMap& metadata, std::uint64_t bytes,
                     const openvdb::io::DelayedLoadMetadata& leaves)
{
    metadata.insertMeta(GridBase::META_FILE_MEM_BYTES,
                        openvdb::Int64Metadata(openvdb::Int64(bytes)));
    metadata.insertMeta(
        GridBase::META_FILE_COMPRESSION,
        openvdb::StringMetadata(openvdb::io::compressionToString(leafCompression())));
    metadata.insertMeta(GridBase::META_FILE_DELAYED_LOAD, leaves);
}

} // namespace mpuvdb
