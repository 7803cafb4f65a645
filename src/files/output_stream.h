// Buffered output whose errors are reported.
#pragma once
#include <filesystem>
#include <functional>
#include <ostream>
#include <string_view>
#include <vector>

namespace mpuvdb
{

/// A buffer before a stream.
class OutputBuffer
{
public:
    explicit OutputBuffer(std::ostream& stream) : mStream(stream) {}
    /// The bytes to append to; flushIfFull() from time to time.
    std::vector<char>& bytes() { return mBytes; }
    void append(const void* data, std::size_t size)
    {
        const char* from = static_cast<const char*>(data);
        mBytes.insert(mBytes.end(), from, from + size);
    }
    /// Append the little-endian bytes of a number.
    template <class T>
    void value(T number)
    {
        append(&number, sizeof number);
    }
    void text(std::string_view words) { append(words.data(), words.size()); }
    void flushIfFull()
    {
        if (mBytes.size() > kFlushBytes) flush();
    }
    void flush()
    {
        mStream.write(mBytes.data(), std::streamsize(mBytes.size()));
        mBytes.clear();
    }

private:
    /// Bytes from which on the buffer is flushed. [free: time against memory]
    static constexpr std::size_t kFlushBytes = std::size_t(1) << 20;

    std::ostream& mStream;
    std::vector<char> mBytes;
};

/// Write @a file by calling @a write; it appears whole or not at all; "-" is stdout.
/// @throws IoError if the bytes cannot be written.
void writeStream(const std::filesystem::path& file,
                 const std::function<void(OutputBuffer&)>& write);

} // namespace mpuvdb
