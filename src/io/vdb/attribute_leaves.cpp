// Attributes of a surface for .vdb files, compressed as they are made.
#include "leaf_files.h"
#include "leaf_format.h"
#include "sampling/attribute_values.h"
#include <mpuvdb/io.h>

#include <openvdb/io/Compression.h>
#include <openvdb/io/DelayedLoadMetadata.h>

#include <array>
#include <memory>
#include <ostream>
#include <streambuf>
#include <string>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

using openvdb::FloatTree;
using openvdb::Index;
using Band = FloatTree::LeafNodeType;

/// Leaves of one attribute, each compressed as in a .vdb file.
struct Leaves {
    std::vector<std::uint32_t> sizes; ///< bytes
    std::string bytes;                ///< of all, one after the other
};

/// Appends to a string, which keeps its memory when it is emptied.
class Appender final : public std::streambuf
{
public:
    std::string bytes;

private:
    std::streamsize xsputn(const char* from, std::streamsize count) override
    {
        bytes.append(from, std::size_t(count));
        return count;
    }
    int overflow(int c) override
    {
        bytes.push_back(char(c));
        return c;
    }
};

/// Compresses the values of leaves' active voxels as OpenVDB does where all others have the
/// background. For one thread.
template <typename Value>
class Squeezer
{
public:
    explicit Squeezer(bool asHalf) : mAsHalf(asHalf), mOut(&mTo) {}

    /// Memory for the values of a leaf's active voxels, in order.
    Value* values() { return mValues.data(); }
    void addTo(Leaves& leaves, const Band::NodeMaskType& active)
    {
        using namespace openvdb::io;
        const std::size_t begin = mTo.bytes.size();
        active.save(mOut);
        mOut.put(NO_MASK_OR_INACTIVE_VALS);
        if (mAsHalf)
            HalfWriter<RealToHalf<Value>::isReal, Value>::write(
                mOut, mValues.data(), active.countOn(), leafCompression());
        else
            writeData(mOut, mValues.data(), active.countOn(), leafCompression());
        leaves.sizes.push_back(std::uint32_t(mTo.bytes.size() - begin));
    }
    void endOf(Leaves& leaves)
    {
        leaves.bytes.assign(mTo.bytes.data(), mTo.bytes.size());
        mTo.bytes.clear();
    }

private:
    bool mAsHalf;
    std::array<Value, Band::SIZE> mValues;
    Appender mTo;
    std::ostream mOut;
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
                mColors = std::make_unique<Squeezer<openvdb::Vec3s>>(head->saveFloatAsHalf());
            else
                mScalars.push_back(std::make_unique<Squeezer<float>>(head->saveFloatAsHalf()));
    }

    /// @param leaves  by attribute; become those like the leaves of @a group.
    void compress(const LeafGroup& group, const std::vector<Leaves*>& leaves)
    {
        mValues.forEach(group, [&](const Band& band, const float* values) {
            const Index count = band.valueMask().countOn();
            for (Index n = 0; n < count; ++n) {
                if (mColors) {
                    mColors->values()[n] = openvdb::Vec3s(values);
                    values += 3;
                }
                for (const auto& scalar : mScalars) scalar->values()[n] = *values++;
            }
            forEach(leaves, [&](auto& of, Leaves& to) { of.addTo(to, band.valueMask()); });
        });
        forEach(leaves, [](auto& of, Leaves& to) { of.endOf(to); });
    }

private:
    template <typename F>
    void forEach(const std::vector<Leaves*>& leaves, const F& f)
    {
        auto to = leaves.begin();
        if (mColors) f(*mColors, **to++);
        for (const auto& scalar : mScalars) f(*scalar, **to++);
    }

    AttributeValues mValues;
    std::unique_ptr<Squeezer<openvdb::Vec3s>> mColors; ///< null without colors
    std::vector<std::unique_ptr<Squeezer<float>>> mScalars;
};

/// A band's tree, shared by the grids of attributes on its voxels.
struct BandTree {
    explicit BandTree(const LevelSet& levelSet)
        : tree(levelSet.grid().constTreePtr()), groups(leafGroups(*tree)),
          voxels(tree->activeVoxelCount())
    {
        tree->evalActiveVoxelBoundingBox(box);
    }

    FloatTree::ConstPtr tree;
    LeafGroups groups;
    openvdb::Index64 voxels;
    openvdb::CoordBBox box; ///< of the active voxels
};

/// A grid on a band's active voxels, of leaves compressed already; all other voxels have the
/// background, zero.
template <typename GridT>
class OnBand final : public GridT, public OfLeaves
{
public:
    using Value = typename GridT::ValueType;

    /// @param leaves  of the band's groups.
    OnBand(const GridT& head, std::shared_ptr<const BandTree> band, std::vector<Leaves>&& leaves,
           const Interrupter& progress)
        : GridT(openvdb::zeroVal<Value>()), mBand(std::move(band)), mLeaves(std::move(leaves)),
          mProgress(progress)
    {
        this->insertMeta(head);
        this->setTransform(head.transform().copy());
    }

    openvdb::Index64 activeVoxelCount() const override { return mBand->voxels; }
    openvdb::CoordBBox evalActiveVoxelBoundingBox() const override { return mBand->box; }
    /// As if the voxels were there: files say what reading them takes.
    openvdb::Index64 memUsage() const override
    {
        using Leaf = typename GridT::TreeType::LeafNodeType;
        using Upper = typename GridT::TreeType::RootNodeType::ChildNodeType;
        const std::vector<openvdb::Index32> nodes = mBand->tree->nodeCount();
        return GridT::memUsage() + nodes[0] * (sizeof(Leaf) + Leaf::SIZE * sizeof(Value)) +
               nodes[1] * bytesOf<typename Upper::ChildNodeType>() + nodes[2] * bytesOf<Upper>();
    }
    openvdb::MetaMap fileMetadata() const override
    {
        openvdb::io::DelayedLoadMetadata delayed;
        delayed.resizeMask(mBand->groups.ofLeaves.size());
        delayed.resizeCompressedSize(mBand->groups.ofLeaves.size());
        std::size_t n = 0;
        forEachLeaf([&](const char*, std::uint32_t size) {
            delayed.setMask(n, openvdb::io::NO_MASK_OR_INACTIVE_VALS);
            delayed.setCompressedSize(n++, size - (kKindAt + 1));
        });
        openvdb::MetaMap metadata(*this);
        addLeafMetadata(metadata, memUsage(), delayed);
        return metadata;
    }
    /// Masks of the band's nodes, without tiles, as OpenVDB's trees write them.
    /// [derived: OpenVDB's format]
    void writeTopology(std::ostream& out) const override
    {
        const auto& root = mBand->tree->root();
        put(out, std::int32_t(1)); // buffers
        put(out, this->background());
        openvdb::io::setGridBackgroundValuePtr(out, &this->background());
        put(out, Index(0)); // tiles
        put(out, root.childCount());
        for (auto upper = root.cbeginChildOn(); upper; ++upper) {
            const openvdb::Coord origin = upper.getCoord();
            for (int axis = 0; axis < 3; ++axis) put(out, origin[axis]);
            writeNode(out, *upper);
        }
    }
    void writeBuffers(std::ostream& out) const override
    {
        std::string some; // leaves are small: many at once save calls of the system
        const auto write = [&] {
            mProgress.check();
            out.write(some.data(), std::streamsize(some.size()));
            some.clear();
        };
        forEachLeaf([&](const char* bytes, std::uint32_t size) {
            if (some.size() + size > kWriteBytes) write();
            some.append(bytes, size);
        });
        write();
    }

private:
    /// As OpenVDB counts them.
    template <typename Node>
    static constexpr std::size_t bytesOf()
    {
        return Node::NUM_VALUES * sizeof(typename Node::UnionType) +
               2 * sizeof(typename Node::NodeMaskType) + sizeof(openvdb::Coord);
    }
    template <typename T>
    static void put(std::ostream& out, const T& value)
    {
        out.write(reinterpret_cast<const char*>(&value), sizeof value);
    }
    template <typename Node>
    void writeNode(std::ostream& out, const Node& node) const
    {
        const typename Node::NodeMaskType& children = node.getChildMask();
        const typename Node::NodeMaskType none;
        children.save(out);
        none.save(out);
        std::vector<Value> tiles(Node::NUM_VALUES, openvdb::zeroVal<Value>());
        openvdb::io::writeCompressedValues(out, tiles.data(), Node::NUM_VALUES, none, children,
                                           this->saveFloatAsHalf());
        for (auto child = node.cbeginChildOn(); child; ++child)
            if constexpr (Node::LEVEL > 1)
                writeNode(out, *child);
            else
                child->valueMask().save(out);
    }
    /// Call f(bytes, their count) for each of the band's leaves, in its order.
    template <typename F>
    void forEachLeaf(F f) const
    {
        struct Next {
            std::size_t leaf = 0, byte = 0;
        };
        std::vector<Next> next(mLeaves.size());
        for (const std::uint32_t group : mBand->groups.ofLeaves) {
            const Leaves& leaves = mLeaves[group];
            Next& at = next[group];
            const std::uint32_t size = leaves.sizes[at.leaf++];
            f(leaves.bytes.data() + at.byte, size);
            at.byte += size;
        }
    }

    static constexpr std::size_t kWriteBytes = 1 << 18; ///< at a time [free: time]

    std::shared_ptr<const BandTree> mBand;
    std::vector<Leaves> mLeaves;
    const Interrupter& mProgress;
};

template <typename GridT>
openvdb::GridBase::ConstPtr onBand(const openvdb::GridBase& head,
                                   const std::shared_ptr<const BandTree>& band,
                                   std::vector<Leaves>&& leaves, const Interrupter& progress)
{
    auto grid = std::make_shared<OnBand<GridT>>(static_cast<const GridT&>(head), band,
                                                std::move(leaves), progress);
    grid->addStatsMetadata();
    return grid;
}

} // namespace

openvdb::GridCPtrVec compressAttributes(const LevelSet& levelSet,
                                        const SurfaceAttributes& attributes,
                                        Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    const std::vector<openvdb::GridBase::Ptr> heads = attributeGridHeads(levelSet, attributes);
    const auto band = std::make_shared<const BandTree>(levelSet);
    const std::vector<LeafGroup>& groups = band->groups.all;
    progress.beginStage("attributes", double(groups.size()));
    std::vector<std::vector<Leaves>> leaves(heads.size());
    for (auto& some : leaves) some.resize(groups.size());
    tbb::enumerable_thread_specific<Thread> threads(
        [&] { return Thread(levelSet, attributes, heads); });
    tbb::parallel_for(std::size_t(0), groups.size(), [&](std::size_t n) {
        std::vector<Leaves*> to;
        to.reserve(leaves.size());
        for (auto& some : leaves) to.push_back(&some[n]);
        threads.local().compress(groups[n], to);
        progress.advance();
    });
    openvdb::GridCPtrVec grids;
    for (std::size_t g = 0; g < heads.size(); ++g)
        grids.push_back(
            heads[g]->isType<openvdb::Vec3SGrid>()
                ? onBand<openvdb::Vec3SGrid>(*heads[g], band, std::move(leaves[g]), progress)
                : onBand<openvdb::FloatGrid>(*heads[g], band, std::move(leaves[g]), progress));
    progress.endStage();
    return grids;
}

} // namespace mpuvdb
