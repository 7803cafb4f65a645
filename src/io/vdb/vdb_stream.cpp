#include "vdb_stream.h"

#include "leaf_files.h"
#include "vdb_layout.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>
#include <openvdb/io/io.h>
#include <openvdb/tree/LeafManager.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstring>
#include <sstream>

namespace mpuvdb
{
namespace
{

using openvdb::GridBase;

/// The error for a grid of an unknown type, with its cure.
std::string unknownType(const std::string& file, const std::string& grid, const std::string& type)
{
    const bool isHalf = type.rfind("Tree_half_", 0) == 0;
    return fmt::format(
        "{}: grid '{}' is {}, which OpenVDB {} cannot read. {}", file, grid,
        isHalf ? "a half grid, of 16 bits a value in memory" : "of the type " + type,
        openvdb::getLibraryVersionString(),
        isHalf ? "Convert it to a grid of floats where it comes from (one of floats may be saved "
                 "as half: that can be read)"
               : "Leave it out of the file, or convert it to floats where it comes from");
}

/// Writes its leaves in their order, part by part, several parts at once.
template <typename GridT>
class ParallelGrid final : public GridT
{
public:
    ParallelGrid(const GridT& grid, const Interrupter& progress)
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
                part.copyfmt(out); // OpenVDB's compression and background
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
    /// The leaves in a part, and the parts at a time: 8 MB of floats. [free: memory]
    static constexpr std::size_t kPart = 64, kPartsAtOnce = 64;

    const Interrupter& mProgress;
};

template <typename GridT>
GridBase::ConstPtr inParallel(const GridBase& grid, const Interrupter& progress)
{
    return openvdb::SharedPtr<const GridT>(
        new ParallelGrid<GridT>(static_cast<const GridT&>(grid), progress));
}

} // namespace

VdbReader::VdbReader(const std::filesystem::path& file, const Interrupter& progress)
    : mFile(file.string()), mMetadata(new openvdb::io::StreamMetadata), mBuffer(progress),
      mStream(&mBuffer)
{
    if (!mBuffer.open(file, std::ios::in | std::ios::binary))
        OPENVDB_THROW(openvdb::IoError, "it cannot be opened");
    mStream.exceptions(std::ios::badbit | std::ios::failbit); // passes on the buffer's exceptions
    readHead();
    mFileMetadata.readMeta(mStream);
    if (inputHasGridOffsets())
        readDescriptors();
    else
        readAll(readGridCount(mStream));
}

/// Gives OpenVDB its own version, as it warns of newer ones on standard error: those that
/// checkVdbLayout() accepts differ in types of grids only.
void VdbReader::readHead()
{
    std::string head(kVdbUuidOffset + kVdbUuidSize, '\0');
    mStream.read(head.data(), std::streamsize(head.size()));
    std::uint32_t version = 0;
    std::memcpy(&version, &head[kVdbVersionOffset], sizeof version);
    version = std::min(version, openvdb::OPENVDB_FILE_VERSION);
    std::memcpy(&head[kVdbVersionOffset], &version, sizeof version);
    std::istringstream known(head);
    readHeader(known);
    mMetadata->setSeekable(true);
    openvdb::io::setStreamMetadataPtr(mStream, mMetadata, /*transfer=*/false);
    setFormatVersion(mStream);
    setLibraryVersion(mStream);
    setDataCompression(mStream);
}

VdbReader::GridDescriptor VdbReader::readDescriptor()
{
    GridDescriptor descriptor;
    try {
        descriptor.read(mStream);
    } catch (const openvdb::LookupError&) {
        throw InputError(unknownType(mFile, GridDescriptor::nameAsString(descriptor.uniqueName()),
                                     descriptor.gridType()));
    }
    return descriptor;
}

void VdbReader::readDescriptors()
{
    for (auto left = readGridCount(mStream); left > 0; --left) {
        const GridDescriptor descriptor = readDescriptor();
        descriptor.seekToEnd(mStream);
        mDescriptors.emplace(descriptor.gridName(), descriptor);
    }
}

void VdbReader::readAll(std::int32_t grids)
{
    for (std::int32_t grid = 0; grid < grids; ++grid) {
        const GridDescriptor descriptor = readDescriptor();
        const GridBase::Ptr created = GridBase::createGrid(descriptor.gridType());
        created->setSaveFloatAsHalf(descriptor.saveFloatAsHalf());
        readGrid(created, descriptor, mStream);
        mDescriptors.emplace(descriptor.gridName(), descriptor);
        mGrids.emplace(descriptor.uniqueName(), created);
    }
    for (const auto& [name, descriptor] : mDescriptors) connectInstance(descriptor, mGrids);
}

std::vector<std::string> VdbReader::names() const
{
    std::vector<std::string> all;
    for (const auto& [name, descriptor] : mDescriptors)
        all.push_back(GridDescriptor::nameAsString(descriptor.uniqueName()));
    return all;
}

const VdbReader::GridDescriptor& VdbReader::find(const std::string& name) const
{
    for (const auto& [there, descriptor] : mDescriptors)
        if (GridDescriptor::nameAsString(descriptor.uniqueName()) == name) return descriptor;
    OPENVDB_THROW(openvdb::KeyError, "it has no grid '" << name << "'");
}

GridBase::ConstPtr VdbReader::metadata(const std::string& name)
{
    const GridDescriptor& descriptor = find(name);
    if (!inputHasGridOffsets()) return mGrids.at(descriptor.uniqueName())->copyGridWithNewTree();
    const GridBase::Ptr grid = GridBase::createGrid(descriptor.gridType());
    descriptor.seekToGrid(mStream);
    readGridCompression(mStream);
    grid->readMeta(mStream);
    grid->readTransform(mStream);
    return grid;
}

GridBase::Ptr VdbReader::read(const std::string& name)
{
    const GridDescriptor& descriptor = find(name);
    if (!inputHasGridOffsets()) return mGrids.at(descriptor.uniqueName());
    GridBase::Ptr grid = read(descriptor);
    if (descriptor.isInstance()) {
        const std::string parent = GridDescriptor::nameAsString(descriptor.instanceParentName());
        grid->setTree(read(find(parent))->baseTreePtr());
    }
    return grid;
}

GridBase::Ptr VdbReader::read(const GridDescriptor& descriptor)
{
    GridBase::Ptr grid = GridBase::createGrid(descriptor.gridType());
    grid->setSaveFloatAsHalf(descriptor.saveFloatAsHalf());
    descriptor.seekToGrid(mStream);
    readGrid(grid, descriptor, mStream);
    return grid;
}

GridBase::ConstPtr compressingInParallel(const GridBase::ConstPtr& grid,
                                         const Interrupter& progress)
{
    if (dynamic_cast<const OfLeaves*>(&*grid)) return grid;
    if (grid->isType<openvdb::FloatGrid>()) return inParallel<openvdb::FloatGrid>(*grid, progress);
    if (grid->isType<openvdb::Vec3SGrid>()) return inParallel<openvdb::Vec3SGrid>(*grid, progress);
    return grid;
}

} // namespace mpuvdb
