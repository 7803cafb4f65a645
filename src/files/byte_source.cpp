#include "byte_source.h"
#include "system_message.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/stat.h>
#include <unistd.h>

namespace mpuvdb
{
namespace
{

/// Bytes of one read. [free: time against memory]
constexpr std::size_t kChunk = std::size_t(1) << 20;
/// Bytes of a piece of what came through a pipe. [free: large enough that memory can lie in files]
constexpr std::size_t kPipedBytes = std::size_t(4) << 20;

[[noreturn]] void throwCannotRead(const std::string& name, int error)
{
    throw IoError(fmt::format("{}: cannot be read: {}. Check the name and its permissions.", name,
                              systemMessage(error)));
}

[[noreturn]] void throwEnds(const ByteSource& source)
{
    throw InputError(fmt::format("{}: ends at byte {} in the middle of its data: the file is "
                                 "truncated. Copy or export it again.",
                                 source.name(), source.size()));
}

} // namespace

ByteSource::ByteSource(const std::filesystem::path& file, Interrupter& progress)
    : mName(file == "-" ? "stdin" : file.string())
{
    mFile = file == "-" ? dup(STDIN_FILENO) : open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (mFile < 0) throwCannotRead(mName, errno);
    struct stat status {
    };
    try {
        if (fstat(mFile, &status) != 0) throwCannotRead(mName, errno);
        if (S_ISDIR(status.st_mode))
            throw IoError(fmt::format("{}: is a folder. Name the files in it.", mName));
        mIsPipe = !S_ISREG(status.st_mode);
        mSize = mIsPipe ? 0 : std::uint64_t(status.st_size);
        if (mIsPipe) readPipe(progress);
    } catch (...) {
        close(mFile);
        throw;
    }
}

ByteSource::~ByteSource()
{
    close(mFile);
}

void ByteSource::readPipe(Interrupter& progress)
{
    for (;;) {
        progress.check();
        pollfd ready{mFile, POLLIN, 0};
        const int polled = poll(&ready, 1, 100); // milliseconds until the next check for a stop
        if (polled < 0 && errno != EINTR) throwCannotRead(mName, errno);
        if (polled <= 0) continue;
        const std::size_t at = mSize % kPipedBytes;
        if (at == 0 && mSize / kPipedBytes == mPiped.size())
            mPiped.emplace_back(new char[kPipedBytes]);
        const ssize_t got = ::read(mFile, mPiped.back().get() + at, kPipedBytes - at);
        if (got < 0 && errno != EINTR && errno != EAGAIN) throwCannotRead(mName, errno);
        if (got == 0) break;
        if (got > 0) mSize += std::uint64_t(got);
    }
}

std::size_t ByteSource::readSome(std::uint64_t offset, char* to, std::size_t bytes) const
{
    if (offset >= mSize) return 0;
    bytes = std::size_t(std::min<std::uint64_t>(bytes, mSize - offset));
    std::size_t done = 0;
    if (mIsPipe) {
        for (std::size_t some = 0; done < bytes; done += some) {
            const std::size_t at = std::size_t(offset + done) % kPipedBytes;
            some = std::min(bytes - done, kPipedBytes - at);
            std::memcpy(to + done, mPiped[(offset + done) / kPipedBytes].get() + at, some);
        }
        return bytes;
    }
    while (done < bytes) {
        const ssize_t got = pread(mFile, to + done, bytes - done, off_t(offset + done));
        if (got < 0 && errno == EINTR) continue;
        if (got < 0) throwCannotRead(mName, errno);
        if (got == 0) break;
        done += std::size_t(got);
    }
    return done;
}

void ByteSource::read(std::uint64_t offset, char* to, std::size_t bytes) const
{
    if (readSome(offset, to, bytes) != bytes) throwEnds(*this);
}

std::string ByteSource::head(std::size_t bytes) const
{
    std::string text(std::size_t(std::min<std::uint64_t>(bytes, mSize)), '\0');
    text.resize(readSome(0, text.data(), text.size()));
    return text;
}

ByteCursor::ByteCursor(const ByteSource& source, std::uint64_t offset)
    : mSource(source), mBase(std::min(offset, source.size()))
{
}

const char* ByteCursor::take(std::size_t bytes)
{
    if (mEnd - mAt < bytes) refill(bytes);
    const char* piece = mBuffer.data() + mAt;
    mAt += bytes;
    return piece;
}

void ByteCursor::refill(std::size_t bytes)
{
    if (bytes > remaining()) throwEnds(mSource);
    std::copy(mBuffer.begin() + std::ptrdiff_t(mAt), mBuffer.begin() + std::ptrdiff_t(mEnd),
              mBuffer.begin());
    mBase += mAt;
    mEnd -= mAt;
    mAt = 0;
    const std::size_t wanted =
        std::size_t(std::min<std::uint64_t>(std::max(bytes, kChunk), remaining()));
    if (mBuffer.size() < wanted) mBuffer.resize(wanted);
    mEnd += mSource.readSome(mBase + mEnd, mBuffer.data() + mEnd, mBuffer.size() - mEnd);
    if (mEnd < bytes) throwEnds(mSource);
}

} // namespace mpuvdb
