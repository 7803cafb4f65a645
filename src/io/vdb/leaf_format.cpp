#include "leaf_format.h"

#include <mpuvdb/error.h>

#include <openvdb/io/Archive.h>
#include <openvdb/io/Compression.h>
#include <openvdb/io/io.h>

#include <sstream>

namespace mpuvdb
{

using openvdb::CoordBBox;
using openvdb::GridBase;

std::uint32_t leafCompression()
{
    return openvdb::io::COMPRESS_ACTIVE_MASK |
           (openvdb::io::Archive::hasBloscCompression() ? openvdb::io::COMPRESS_BLOSC
                                                        : openvdb::io::COMPRESS_ZIP);
}

void damagedLeaves()
{
    throw InputError("a part of a grid is damaged: make it again");
}

std::vector<LeafPlace> leafPlaces(const std::vector<ArrayFile>& files, const std::string& prefix,
                                  const CoordBBox& box, const Interrupter& progress)
{
    std::vector<LeafPlace> places;
    for (const ArrayFile& file : files) {
        progress.check();
        // Their memory is that of the file.
        const auto heads = file.get<LeafHead>(prefix + "leaves");
        const auto bytes = file.get<char>(prefix + "voxels");
        std::size_t at = 0;
        for (const LeafHead& head : heads) {
            if (head.bytes <= kKindAt || head.bytes > bytes.size() - at) damagedLeaves();
            const LeafPlace place{&head, bytes.data() + at};
            if (box.isInside(place.origin())) places.push_back(place);
            at += head.bytes;
        }
    }
    return places;
}

GridBase::Ptr leafGridHead(const ArrayFile& file, const std::string& prefix)
{
    openvdb::initialize();
    const StoredArray<char> bytes = file.get<char>(prefix + "head");
    std::istringstream head(std::string(bytes.begin(), bytes.end()));
    openvdb::io::setVersion(head, {}, openvdb::OPENVDB_FILE_VERSION);
    std::string type;
    std::getline(head, type);
    if (type != openvdb::FloatGrid::gridType() && type != openvdb::Vec3SGrid::gridType())
        damagedLeaves();
    const GridBase::Ptr grid = GridBase::createGrid(type);
    grid->readMeta(head);
    grid->readTransform(head);
    return grid;
}

} // namespace mpuvdb
