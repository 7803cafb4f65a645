// OpenVDB's files with interruptible streams, newer formats, and leaves compressed on all threads.
#pragma once
#include <mpuvdb/interrupter.h>

#include <openvdb/io/Archive.h>
#include <openvdb/io/GridDescriptor.h>
#include <openvdb/openvdb.h>

#include <filesystem>
#include <fstream>
#include <istream>
#include <map>
#include <string>
#include <vector>

namespace mpuvdb
{

/// A file buffer that checks an interrupter at every read and write.
class InterruptibleBuffer : public std::filebuf
{
public:
    explicit InterruptibleBuffer(const Interrupter& progress) : mProgress(progress) {}

protected:
    std::streamsize xsputn(const char* data, std::streamsize size) override
    {
        mProgress.check();
        return std::filebuf::xsputn(data, size);
    }
    std::streamsize xsgetn(char* data, std::streamsize size) override
    {
        mProgress.check();
        return std::filebuf::xsgetn(data, size);
    }

private:
    const Interrupter& mProgress;
};

/// An interruptible openvdb::io::File. Grids are read whole: delayed loading maps the file, and a
/// mapped file that changes ends the process.
class VdbReader : public openvdb::io::Archive
{
public:
    /// Reads all grids of a file without offsets, else none. @param progress  may stop all reading;
    /// has to outlive the reader.
    /// @throws InputError (a grid of a type that this OpenVDB does not have), Interrupted, and
    /// OpenVDB's exceptions.
    VdbReader(const std::filesystem::path& file, const Interrupter& progress);

    const std::string& filename() const { return mFile; }
    /// In File's order; equal names have numbers appended.
    std::vector<std::string> names() const;
    /// A grid with its metadata and transform, without its tree.
    openvdb::GridBase::ConstPtr metadata(const std::string& name);
    const openvdb::MetaMap& fileMetadata() const { return mFileMetadata; }
    openvdb::GridBase::Ptr read(const std::string& name);

private:
    using GridDescriptor = openvdb::io::GridDescriptor;

    void readHead();
    void readDescriptors();
    void readAll(std::int32_t grids);
    GridDescriptor readDescriptor();
    const GridDescriptor& find(const std::string& name) const;
    openvdb::GridBase::Ptr read(const GridDescriptor& descriptor);

    std::string mFile;
    openvdb::MetaMap mFileMetadata;
    openvdb::io::StreamMetadata::Ptr mMetadata; ///< the stream points to it
    InterruptibleBuffer mBuffer;
    std::istream mStream;
    std::multimap<std::string, GridDescriptor> mDescriptors; ///< by the names of grids
    NamedGridMap mGrids; ///< of a file without offsets, by unique names
};

/// A grid that shares @a grid's tree, whose leaves are compressed on all threads when an archive
/// writes it: the same bytes, in less time. Grids of other types than FloatGrid and Vec3SGrid, and
/// those of compressed leaves, are returned as they are. @param progress  may stop the writing; has
/// to outlive the grid.
openvdb::GridBase::ConstPtr compressingInParallel(const openvdb::GridBase::ConstPtr& grid,
                                                  const Interrupter& progress);

} // namespace mpuvdb
