#include "array_file.h"
#include "system_message.h"

#include "mapped_pages.h"

#include <mpuvdb/error.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <fmt/format.h>
#include <stdexcept>
#include <sys/mman.h>
#include <sys/stat.h>
#include <system_error>
#include <unistd.h>
#include <utility>

namespace mpuvdb
{
namespace
{

/// First bytes of a file; the last one is the format's version. [derived: the format]
constexpr std::array<char, 8> kMagic = {'m', 'p', 'u', 'a', 'r', 'r', 'a', '1'};
/// Alignment of arrays, bytes. [derived: a cache line, and any element]
constexpr std::uint64_t kAlignment = 64;
/// Most arrays of a file. [free: a table's size]
constexpr std::size_t kMostArrays = 256;

/// @throws IoError for the system's error number @a error.
[[noreturn]] void notWritten(const std::filesystem::path& file, int error)
{
    throw IoError(fmt::format("{}: cannot be written: {}. Free some space, or use another disk",
                              file.string(), systemMessage(error)),
                  error);
}

struct Head {
    std::array<char, 8> magic = kMagic;
    std::uint64_t directory = 0, arrays = 0, size = 0; ///< offset; number; of the file, bytes
};

} // namespace

struct ArrayFileWriter::Entry {
    std::array<char, 32> name{};
    std::uint64_t offset = 0, count = 0, size = 0; ///< bytes; elements; bytes of an element
};

ArrayFileWriter::ArrayFileWriter(const std::filesystem::path& file) : mFile(file), mEnd(kAlignment)
{
    mDescriptor = ::open(file.c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    if (mDescriptor < 0) notWritten(file, errno);
}

ArrayFileWriter::~ArrayFileWriter()
{
    if (mDescriptor >= 0) ::close(mDescriptor);
}

std::size_t ArrayFileWriter::reserveBytes(const std::string& name, std::size_t count,
                                          std::size_t size)
{
    Entry entry;
    if (mEntries.size() == kMostArrays || name.size() >= entry.name.size())
        throw std::logic_error("array '" + name + "': too many arrays, or too long a name");
    std::copy(name.begin(), name.end(), entry.name.begin());
    entry.offset = mEnd;
    entry.count = count;
    entry.size = size;
    mEnd = (mEnd + count * size + kAlignment - 1) / kAlignment * kAlignment;
    mEntries.push_back(entry);
    return mEntries.size() - 1;
}

void ArrayFileWriter::writeBytes(std::size_t number, std::uint64_t from, const void* data,
                                 std::size_t bytes)
{
    const Entry& entry = mEntries[number];
    if (from + bytes > entry.count * entry.size)
        throw std::logic_error("more elements than were set aside");
    writeAt(entry.offset + from, data, bytes);
}

void ArrayFileWriter::writeAt(std::uint64_t offset, const void* data, std::size_t bytes)
{
    const char* from = static_cast<const char*>(data);
    while (bytes > 0) {
        const ssize_t done = ::pwrite(mDescriptor, from, bytes, off_t(offset));
        if (done < 0 && errno == EINTR) continue;
        if (done <= 0) notWritten(mFile, errno);
        from += done;
        offset += std::uint64_t(done);
        bytes -= std::size_t(done);
    }
}

void ArrayFileWriter::finish()
{
    Head head;
    head.directory = mEnd;
    head.arrays = mEntries.size();
    head.size = mEnd + mEntries.size() * sizeof(Entry);
    writeAt(mEnd, mEntries.data(), mEntries.size() * sizeof(Entry));
    writeAt(0, &head, sizeof head);
    const int closed = ::close(std::exchange(mDescriptor, -1));
    if (closed != 0) notWritten(mFile, errno);
}

struct ArrayFile::Mapping {
    void* data = nullptr;
    std::size_t bytes = 0;

    Mapping(int descriptor, std::size_t size)
        : data(::mmap(nullptr, size, PROT_READ, MAP_SHARED, descriptor, 0)), bytes(size)
    {
        if (data != MAP_FAILED) keepTrackOfPages(data, bytes);
    }
    Mapping(const Mapping&) = delete;
    Mapping& operator=(const Mapping&) = delete;
    ~Mapping()
    {
        if (data == MAP_FAILED) return;
        loseTrackOfPages(data);
        ::munmap(data, bytes);
    }
};

ArrayFile::ArrayFile(const std::filesystem::path& file) : mFile(file)
{
    const int descriptor = ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
    struct stat status {
    };
    if (descriptor < 0 || ::fstat(descriptor, &status) != 0) {
        const int error = errno;
        if (descriptor >= 0) ::close(descriptor);
        throw IoError(fmt::format("{}: cannot be read: {}. Make it again, or allow reading it",
                                  file.string(), systemMessage(error)),
                      error);
    }
    const auto size = std::size_t(status.st_size);
    if (size >= sizeof(Head)) mMapping = std::make_shared<const Mapping>(descriptor, size);
    ::close(descriptor);
    if (!mMapping || mMapping->data == MAP_FAILED) damaged("head");
    const char* const bytes = static_cast<const char*>(mMapping->data);
    Head head;
    std::memcpy(&head, bytes, sizeof head);
    using Entry = ArrayFileWriter::Entry;
    if (head.magic != kMagic || head.size != size || head.arrays > kMostArrays ||
        head.directory > size || size - head.directory != head.arrays * sizeof(Entry))
        damaged("head");
    for (std::size_t n = 0; n < head.arrays; ++n) {
        Entry entry;
        std::memcpy(&entry, bytes + head.directory + n * sizeof entry, sizeof entry);
        entry.name.back() = '\0';
        if (entry.offset % kAlignment != 0 || entry.offset > head.directory || entry.size == 0 ||
            entry.count > (head.directory - entry.offset) / entry.size)
            damaged(entry.name.data());
        mEntries[entry.name.data()] = {bytes + entry.offset, std::size_t(entry.count),
                                       std::size_t(entry.size)};
    }
}

ArrayFile::Part ArrayFile::find(const std::string& name, std::size_t size) const
{
    const auto found = mEntries.find(name);
    if (found == mEntries.end() || found->second.size != size) damaged(name);
    return found->second;
}

void ArrayFile::damaged(const std::string& what) const
{
    throw InputError(fmt::format("{}: '{}' is damaged, or of another version of mpuvdb: make the "
                                 "file again",
                                 mFile.string(), what));
}

} // namespace mpuvdb
