// Attributes of a surface for .vdb files, compressed as they are made.
#include "leaf_files.h"
#include "sampling/attribute_values.h"
#include <mpuvdb/io.h>

#include <memory>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

using Band = openvdb::FloatTree::LeafNodeType;

/// Compresses leaves of one attribute, each in the memory of the last one. For one thread.
template <typename GridT>
class Squeezer
{
public:
    using Leaf = typename GridT::TreeType::LeafNodeType;

    explicit Squeezer(const openvdb::GridBase& head)
        : mBackground(static_cast<const GridT&>(head).background()),
          mCompressor(mBackground, head.saveFloatAsHalf())
    {
        mLeaf.allocate();
    }
    /// The values of a leaf like @a band.
    typename Leaf::ValueType* begin(const Band& band)
    {
        mLeaf.setOrigin(band.origin());
        mLeaf.setValueMask(band.valueMask());
        mLeaf.buffer().fill(mBackground);
        return mLeaf.buffer().data();
    }
    void addTo(CompressedLeaves& leaves) { leaves.heads.push_back(mCompressor.add(mLeaf)); }
    void endOf(CompressedLeaves& leaves) { leaves.bytes = mCompressor.take(); }

private:
    typename Leaf::ValueType mBackground;
    Leaf mLeaf;
    LeafCompressor<Leaf> mCompressor;
};

/// The memory of one thread.
class Thread
{
public:
    Thread(const LevelSet& levelSet, const SurfaceAttributes& attributes,
           const std::vector<openvdb::GridBase::Ptr>& heads)
        : mValues(levelSet, attributes)
    {
        for (const openvdb::GridBase::Ptr& head : heads)
            if (head->isType<openvdb::Vec3SGrid>())
                mColors = std::make_unique<Squeezer<openvdb::Vec3SGrid>>(*head);
            else
                mScalars.push_back(std::make_unique<Squeezer<openvdb::FloatGrid>>(*head));
    }

    /// @param leaves  by attribute; become those like the leaves of @a group.
    void compress(const LeafGroup& group, const std::vector<CompressedLeaves*>& leaves)
    {
        mValues.forEach(group, [&](const Band& band, const auto& set) {
            AttributeVoxels voxels;
            if (mColors) voxels.color = mColors->begin(band);
            for (const auto& scalar : mScalars) voxels.scalars.push_back(scalar->begin(band));
            set(voxels);
            forEach(leaves, [](auto& of, CompressedLeaves& to) { of.addTo(to); });
        });
        forEach(leaves, [](auto& of, CompressedLeaves& to) { of.endOf(to); });
    }

private:
    template <typename F>
    void forEach(const std::vector<CompressedLeaves*>& leaves, const F& f)
    {
        auto to = leaves.begin();
        if (mColors) f(*mColors, **to++);
        for (const auto& scalar : mScalars) f(*scalar, **to++);
    }

    AttributeValues mValues;
    std::unique_ptr<Squeezer<openvdb::Vec3SGrid>> mColors; ///< null without colors
    std::vector<std::unique_ptr<Squeezer<openvdb::FloatGrid>>> mScalars;
};

} // namespace

openvdb::GridCPtrVec compressAttributes(const LevelSet& levelSet,
                                        const SurfaceAttributes& attributes,
                                        Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    const std::vector<openvdb::GridBase::Ptr> heads = attributeGridHeads(levelSet, attributes);
    const std::vector<LeafGroup> groups = leafGroups(levelSet.grid().tree());
    progress.beginStage("attributes", double(groups.size()));
    std::vector<std::vector<CompressedLeaves>> leaves(heads.size());
    for (auto& some : leaves) some.resize(groups.size());
    tbb::enumerable_thread_specific<Thread> threads(
        [&] { return Thread(levelSet, attributes, heads); });
    tbb::parallel_for(std::size_t(0), groups.size(), [&](std::size_t n) {
        std::vector<CompressedLeaves*> to;
        to.reserve(leaves.size());
        for (auto& some : leaves) to.push_back(&some[n]);
        threads.local().compress(groups[n], to);
        progress.advance();
    });
    openvdb::GridCPtrVec grids;
    for (std::size_t g = 0; g < heads.size(); ++g)
        grids.push_back(gridOfLeaves(*heads[g], std::move(leaves[g]), progress));
    progress.endStage();
    return grids;
}

} // namespace mpuvdb
