// The leaves of a grid in files of arrays, as leaf_files.h writes and reads them.
#pragma once
#include "files/array_file.h"
#include <mpuvdb/interrupter.h>

#include <openvdb/io/io.h>
#include <openvdb/openvdb.h>

#include <array>
#include <cstdint>
#include <sstream>
#include <string>
#include <type_traits>
#include <vector>

namespace mpuvdb
{

/// A leaf as files have it, without its voxels.
struct LeafHead {
    std::array<std::int32_t, 3> origin{};
    std::uint32_t bytes = 0;                      ///< of its voxels, compressed
    std::array<std::uint64_t, 8> mask{};          ///< active voxels
    std::uint8_t firstInside = 0, lastInside = 0; ///< signs of its first and its last voxel
    std::array<std::uint8_t, 6> unused{};         ///< so that equal leaves have equal bytes
};

/// Where the bytes of a leaf are, in the memory of its mapped file.
struct LeafPlace {
    const LeafHead* head;
    const char* bytes;

    openvdb::Coord origin() const { return {head->origin[0], head->origin[1], head->origin[2]}; }
    template <typename NodeMask>
    NodeMask mask() const
    {
        NodeMask mask;
        for (std::size_t w = 0; w < head->mask.size(); ++w)
            mask.template getWord<std::uint64_t>(openvdb::Index(w)) = head->mask[w];
        return mask;
    }
};

/// What a leaf's bytes begin with: its mask, and a byte that says what of its inactive voxels
/// follows before the active ones. [derived: OpenVDB's format]
constexpr std::size_t kKindAt = 64;

/// How leaves are compressed.
std::uint32_t leafCompression();

/// Compresses leaves, one after the other.
template <typename Leaf>
class LeafCompressor
{
public:
    /// @param background  of the grid. @param asHalf  floats are written as half floats.
    LeafCompressor(const typename Leaf::ValueType& background, bool asHalf)
        : mBackground(background), mAsHalf(asHalf)
    {
        openvdb::io::setVersion(mOut, {}, openvdb::OPENVDB_FILE_VERSION);
        openvdb::io::setDataCompression(mOut, leafCompression());
        openvdb::io::setGridBackgroundValuePtr(mOut, &mBackground);
    }
    LeafCompressor(const LeafCompressor&) = delete;
    LeafCompressor& operator=(const LeafCompressor&) = delete;

    LeafHead add(const Leaf& leaf)
    {
        const auto begin = mOut.tellp();
        leaf.writeBuffers(mOut, mAsHalf);
        LeafHead head;
        head.origin = {leaf.origin()[0], leaf.origin()[1], leaf.origin()[2]};
        head.bytes = std::uint32_t(mOut.tellp() - begin);
        for (std::size_t w = 0; w < head.mask.size(); ++w)
            head.mask[w] = leaf.getValueMask().template getWord<std::uint64_t>(openvdb::Index(w));
        if constexpr (std::is_same_v<typename Leaf::ValueType, float>) {
            head.firstInside = leaf.getFirstValue() < 0;
            head.lastInside = leaf.getLastValue() < 0;
        }
        return head;
    }
    /// The bytes of the leaves that were added since the last call.
    std::string take()
    {
        std::string bytes = mOut.str();
        mOut.str({});
        return bytes;
    }

private:
    std::ostringstream mOut;
    typename Leaf::ValueType mBackground;
    bool mAsHalf;
};

/// The places of the leaves of @a files in @a box, file after file.
/// @throws InputError (damaged files), Interrupted.
std::vector<LeafPlace> leafPlaces(const std::vector<ArrayFile>& files, const std::string& prefix,
                                  const openvdb::CoordBBox& box, const Interrupter& progress);

/// A grid without a tree, with the type, the metadata and the transform that @a file has for it.
openvdb::GridBase::Ptr leafGridHead(const ArrayFile& file, const std::string& prefix);

[[noreturn]] void damagedLeaves();

} // namespace mpuvdb
