#include "output_stream.h"
#include "system_message.h"

#include "atomic_file.h"
#include <mpuvdb/error.h>

#include <cerrno>
#include <cstring>
#include <fmt/format.h>
#include <fstream>
#include <iostream>

namespace mpuvdb
{
namespace
{

void writeThrough(std::ostream& stream, const std::string& name,
                  const std::function<void(OutputBuffer&)>& write)
{
    OutputBuffer buffer(stream);
    errno = 0;
    write(buffer);
    buffer.flush();
    stream.flush();
    if (!stream)
        throw IoError(fmt::format("{}: cannot be written: {}. Check the disk and its permissions.",
                                  name, systemMessage(errno != 0 ? errno : EIO)));
}

} // namespace

void writeStream(const std::filesystem::path& file, const std::function<void(OutputBuffer&)>& write)
{
    if (file == "-") {
        writeThrough(std::cout, "stdout", write);
        return;
    }
    writeAtomically(file, [&](const std::filesystem::path& temporary) {
        std::ofstream stream(temporary, std::ios::binary);
        writeThrough(stream, file.string(), write);
    });
}

} // namespace mpuvdb
