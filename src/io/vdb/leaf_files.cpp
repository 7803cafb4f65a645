#include "leaf_files.h"

#include <mpuvdb/error.h>

#include <openvdb/io/Compression.h>
#include <openvdb/io/DelayedLoadMetadata.h>
#include <openvdb/io/io.h>
#include <openvdb/tree/LeafManager.h>
#include <openvdb/tree/NodeManager.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <map>
#include <sstream>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using openvdb::CoordBBox;
using openvdb::GridBase;

/// A leaf as files have it, without its voxels.
struct LeafHead {
    std::array<std::int32_t, 3> origin{};
    std::uint32_t bytes = 0;                      ///< of its voxels, compressed
    std::array<std::uint64_t, 8> mask{};          ///< active voxels
    std::uint8_t firstInside = 0, lastInside = 0; ///< signs of its first and its last voxel
    std::array<std::uint8_t, 6> unused{};         ///< so that equal leaves have equal bytes
};

/// Leaves compressed at a time. [free: memory]
constexpr std::size_t kBatch = 4096;

std::uint32_t compression()
{
    return openvdb::io::COMPRESS_ACTIVE_MASK |
           (openvdb::io::Archive::hasBloscCompression() ? openvdb::io::COMPRESS_BLOSC
                                                        : openvdb::io::COMPRESS_ZIP);
}

bool isInside(float value)
{
    return value < 0;
}

bool isInside(const openvdb::Vec3s&)
{
    return false;
}

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
            const Leaf& leaf = *leaves[begin + n];
            std::ostringstream out;
            openvdb::io::setVersion(out, {}, openvdb::OPENVDB_FILE_VERSION);
            openvdb::io::setDataCompression(out, compression());
            openvdb::io::setGridBackgroundValuePtr(out, &background);
            leaf.writeBuffers(out, grid.saveFloatAsHalf());
            made[n] = out.str();
            LeafHead& head = heads[begin + n];
            head.origin = {leaf.origin()[0], leaf.origin()[1], leaf.origin()[2]};
            head.bytes = std::uint32_t(made[n].size());
            for (std::size_t w = 0; w < head.mask.size(); ++w)
                head.mask[w] =
                    leaf.getValueMask().template getWord<std::uint64_t>(openvdb::Index(w));
            head.firstInside = isInside(leaf.getFirstValue());
            head.lastInside = isInside(leaf.getLastValue());
        });
        for (const std::string& leaf : made) bytes.insert(bytes.end(), leaf.begin(), leaf.end());
    }
    file.add(prefix + "head", headOf(grid));
    file.addValue(prefix + "background", background);
    file.add(prefix + "leaves", heads);
    file.add(prefix + "voxels", bytes);
}

/// Where the bytes of a leaf are.
struct LeafPlace {
    const LeafHead* head;
    const char* bytes;
};

/// A grid whose leaves have masks, and no voxels: those are copied from files.
class OfLeaves
{
public:
    virtual ~OfLeaves() = default;
    virtual openvdb::MetaMap fileMetadata() const = 0;
};

/// What a leaf's bytes begin with: its mask, and a byte that says what of its inactive voxels
/// follows before the active ones. [derived: OpenVDB's format]
constexpr std::size_t kKindAt = 64;

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
        copy->insertMeta(GridBase::META_FILE_MEM_BYTES,
                         openvdb::Int64Metadata(openvdb::Int64(bytes)));
        copy->insertMeta(GridBase::META_FILE_COMPRESSION,
                         openvdb::StringMetadata(openvdb::io::compressionToString(compression())));
        openvdb::io::DelayedLoadMetadata delayed;
        delayed.resizeMask(mPlaces.size());
        delayed.resizeCompressedSize(mPlaces.size());
        std::size_t n = 0;
        for (auto leaf = this->tree().cbeginLeaf(); leaf; ++leaf, ++n) {
            const LeafPlace& place = mPlaces[leaf->transientData()];
            delayed.setMask(n, kindOf(place.bytes));
            delayed.setCompressedSize(n, activeBytes(place, sizeof(typename Leaf::ValueType)));
        }
        copy->insertMeta(GridBase::META_FILE_DELAYED_LOAD, delayed);
        return *copy;
    }

private:
    std::vector<LeafPlace> mPlaces; ///< by the leaves' transient data
    const Interrupter& mProgress;
};

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
                                           : isInside(node.getTable()[0].getValue());
    }
    template <typename Node>
    bool isLastInside(const Node& node) const
    {
        constexpr openvdb::Index kLast = Node::NUM_VALUES - 1; ///< child [derived: OpenVDB's]
        return node.getChildMask().isOn(kLast) ? isLastInside(childAt(node, kLast))
                                               : isInside(node.getTable()[kLast].getValue());
    }

    const std::vector<LeafPlace>& mPlaces;
    float mBackground;
};

void fillSigns(openvdb::FloatTree& tree, const std::vector<LeafPlace>& places)
{
    const SignFill fill(places, tree.background());
    openvdb::tree::NodeManager<openvdb::FloatTree> nodes(tree);
    nodes.foreachBottomUp(fill);
}

void fillSigns(openvdb::Vec3STree&, const std::vector<LeafPlace>&) {}

[[noreturn]] void damaged()
{
    throw InputError("a part of a grid is damaged: make it again");
}

/// The leaves of one file.
std::vector<LeafPlace> placesIn(const ArrayFile& file, const std::string& prefix,
                                std::vector<StoredArray<LeafHead>>& heads)
{
    heads.push_back(file.get<LeafHead>(prefix + "leaves"));
    const StoredArray<char> bytes = file.get<char>(prefix + "voxels");
    std::vector<LeafPlace> places;
    std::size_t at = 0;
    for (const LeafHead& head : heads.back()) {
        if (head.bytes <= kKindAt || head.bytes > bytes.size() - at) damaged();
        places.push_back({&head, bytes.data() + at});
        at += head.bytes;
    }
    return places;
}

template <typename GridT>
GridBase::Ptr joined(const std::vector<ArrayFile>& files, const std::string& prefix,
                     std::istream& head, const Interrupter& progress)
{
    using Tree = typename GridT::TreeType;
    using Leaf = typename Tree::LeafNodeType;
    const auto background =
        files.front().template value<typename GridT::ValueType>(prefix + "background");
    auto tree = std::make_shared<Tree>(background);
    std::vector<LeafPlace> places;
    std::vector<StoredArray<LeafHead>> heads; // whose memory is that of the files
    for (const ArrayFile& file : files) {
        progress.check();
        for (const LeafPlace& place : placesIn(file, prefix, heads)) {
            const auto& o = place.head->origin;
            auto leaf = std::make_unique<Leaf>(openvdb::PartialCreate(), Coord(o[0], o[1], o[2]),
                                               background, false);
            typename Leaf::NodeMaskType mask;
            for (std::size_t w = 0; w < place.head->mask.size(); ++w)
                mask.template getWord<std::uint64_t>(openvdb::Index(w)) = place.head->mask[w];
            leaf->setValueMask(mask);
            leaf->setTransientData(openvdb::Index32(places.size()));
            places.push_back(place);
            tree->addLeaf(leaf.release());
        }
    }
    if (tree->leafCount() != places.size()) damaged(); // two of one place
    fillSigns(*tree, places);
    auto grid =
        openvdb::SharedPtr<GridT>(new GridOfLeaves<GridT>(tree, std::move(places), progress));
    grid->readMeta(head);
    grid->readTransform(head);
    return grid;
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

GridBase::Ptr gridOfLeaves(const std::vector<ArrayFile>& files, const std::string& prefix,
                           const Interrupter& progress)
{
    openvdb::initialize();
    if (files.empty()) throw InputError("there are no parts of a grid");
    const StoredArray<char> bytes = files.front().get<char>(prefix + "head");
    std::istringstream head(std::string(bytes.begin(), bytes.end()));
    openvdb::io::setVersion(head, {}, openvdb::OPENVDB_FILE_VERSION);
    std::string type;
    std::getline(head, type);
    if (type == openvdb::FloatGrid::gridType())
        return joined<openvdb::FloatGrid>(files, prefix, head, progress);
    if (type == openvdb::Vec3SGrid::gridType())
        return joined<openvdb::Vec3SGrid>(files, prefix, head, progress);
    damaged();
}

bool isOfLeaves(const GridBase& grid)
{
    return dynamic_cast<const OfLeaves*>(&grid) != nullptr;
}

openvdb::MetaMap fileMetadata(const GridBase& grid)
{
    return dynamic_cast<const OfLeaves&>(grid).fileMetadata();
}

} // namespace mpuvdb
