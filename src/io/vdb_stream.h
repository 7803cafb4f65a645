// What OpenVDB's files lack: streams that can be stopped, and leaves compressed on all threads.
#pragma once
#include <mpuvdb/progress.h>

#include <openvdb/openvdb.h>

#include <filesystem>
#include <fstream>
#include <string>

namespace mpuvdb
{

/// A file that can be told to stop between two pieces of it.
class StoppableBuffer : public std::filebuf
{
public:
    explicit StoppableBuffer(const Progress& progress) : mProgress(progress) {}

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
    const Progress& mProgress;
};

/// The grid that openvdb::io::File calls @a name; null if the file tells no places of its grids:
/// File has read them all then. @throws what OpenVDB throws, Interrupted.
openvdb::GridBase::Ptr readVdbGrid(const std::filesystem::path& file, const std::string& name,
                                   const Progress& progress);

/// A grid that shares @a grid's tree, whose leaves are compressed on all threads when an archive
/// writes it: the same bytes, in less time. Grids of other values than floats and vectors of them
/// are returned as they are. @param progress  may stop the writing; has to outlive the grid.
openvdb::GridBase::ConstPtr compressingInParallel(const openvdb::GridBase::ConstPtr& grid,
                                                  const Progress& progress);

} // namespace mpuvdb
