#include "vdb_stream.h"

#include <openvdb/io/Archive.h>
#include <openvdb/io/GridDescriptor.h>
#include <openvdb/io/io.h>

#include <map>

namespace mpuvdb
{
namespace
{

using openvdb::GridBase;
using openvdb::io::GridDescriptor;

/// What openvdb::io::File does, on a stream of ours.
class Reader : public openvdb::io::Archive
{
public:
    Reader(const std::filesystem::path& file, const Progress& progress)
        : mMetadata(new openvdb::io::StreamMetadata), mBuffer(progress), mStream(&mBuffer)
    {
        if (!mBuffer.open(file, std::ios::in | std::ios::binary))
            OPENVDB_THROW(openvdb::IoError, "it cannot be opened");
        mStream.exceptions(std::ios::badbit); // what the buffer throws goes on
        readHeader(mStream);
        mMetadata->setSeekable(true);
        openvdb::io::setStreamMetadataPtr(mStream, mMetadata, /*transfer=*/false);
        setFormatVersion(mStream);
        setLibraryVersion(mStream);
        setDataCompression(mStream);
        openvdb::MetaMap().readMeta(mStream);
        if (inputHasGridOffsets()) readDescriptors();
    }

    GridBase::Ptr read(const std::string& name)
    {
        if (!inputHasGridOffsets()) return nullptr;
        const GridDescriptor& descriptor = find(name);
        GridBase::Ptr grid = read(descriptor);
        if (descriptor.isInstance()) {
            const std::string parent =
                GridDescriptor::nameAsString(descriptor.instanceParentName());
            grid->setTree(read(find(parent))->baseTreePtr());
        }
        return grid;
    }

private:
    void readDescriptors()
    {
        for (auto left = readGridCount(mStream); left > 0; --left) {
            GridDescriptor descriptor;
            descriptor.read(mStream);
            descriptor.seekToEnd(mStream);
            mDescriptors.emplace(GridDescriptor::nameAsString(descriptor.uniqueName()), descriptor);
        }
    }
    const GridDescriptor& find(const std::string& name) const
    {
        const auto found = mDescriptors.find(name);
        if (found == mDescriptors.end())
            OPENVDB_THROW(openvdb::KeyError, "it has no grid '" << name << "'");
        return found->second;
    }
    GridBase::Ptr read(const GridDescriptor& descriptor)
    {
        GridBase::Ptr grid = GridBase::createGrid(descriptor.gridType());
        grid->setSaveFloatAsHalf(descriptor.saveFloatAsHalf());
        descriptor.seekToGrid(mStream);
        readGrid(grid, descriptor, mStream);
        return grid;
    }

    openvdb::io::StreamMetadata::Ptr mMetadata; ///< the stream points to it
    StoppableBuffer mBuffer;
    std::istream mStream;
    std::map<std::string, GridDescriptor> mDescriptors; ///< by the names of File
};

} // namespace

GridBase::Ptr readVdbGrid(const std::filesystem::path& file, const std::string& name,
                          const Progress& progress)
{
    return Reader(file, progress).read(name);
}

} // namespace mpuvdb
