#include "vdb_stream.h"

#include <openvdb/io/Archive.h>
#include <openvdb/io/GridDescriptor.h>
#include <openvdb/io/io.h>
#include <openvdb/tree/LeafManager.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <map>
#include <sstream>
#include <vector>

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

/// Writes its leaves in their order, part by part, several parts at once.
template <typename GridT>
class ParallelGrid final : public GridT
{
public:
    ParallelGrid(const GridT& grid, const Progress& progress)
        : GridT(const_cast<GridT&>(grid), openvdb::ShallowCopy()), mProgress(progress)
    {
    }

    void writeBuffers(std::ostream& out) const override
    {
        const openvdb::tree::LeafManager<const typename GridT::TreeType> leaves(this->tree());
        std::vector<std::string> parts(kPartsAtOnce);
        for (std::size_t begin = 0; begin < leaves.leafCount(); begin += kPart * kPartsAtOnce) {
            mProgress.check();
            tbb::parallel_for(std::size_t(0), kPartsAtOnce, [&](std::size_t n) {
                const std::size_t first = std::min(begin + kPart * n, leaves.leafCount());
                std::ostringstream part;
                part.copyfmt(out); // what OpenVDB has noted there: compression, background
                for (std::size_t leaf = first; leaf < std::min(first + kPart, leaves.leafCount());
                     ++leaf)
                    leaves.leaf(leaf).writeBuffers(part, this->saveFloatAsHalf());
                parts[n] = part.str();
            });
            for (const std::string& part : parts)
                out.write(part.data(), std::streamsize(part.size()));
        }
    }

private:
    static constexpr std::size_t kPart = 64, kPartsAtOnce = 64; ///< leaves; 8 MB of floats

    const Progress& mProgress;
};

template <typename GridT>
GridBase::ConstPtr inParallel(const GridBase& grid, const Progress& progress)
{
    return openvdb::SharedPtr<const GridT>(
        new ParallelGrid<GridT>(static_cast<const GridT&>(grid), progress));
}

} // namespace

GridBase::Ptr readVdbGrid(const std::filesystem::path& file, const std::string& name,
                          const Progress& progress)
{
    return Reader(file, progress).read(name);
}

GridBase::ConstPtr compressingInParallel(const GridBase::ConstPtr& grid, const Progress& progress)
{
    if (grid->isType<openvdb::FloatGrid>()) return inParallel<openvdb::FloatGrid>(*grid, progress);
    if (grid->isType<openvdb::Vec3SGrid>()) return inParallel<openvdb::Vec3SGrid>(*grid, progress);
    return grid;
}

} // namespace mpuvdb
