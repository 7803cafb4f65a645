// The bytes of one input: a regular file read piecewise, or a pipe read to its end.
#pragma once
#include "decimal_commas.h"
#include "digit_groups.h"

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// An input that can be read at any offset, from many threads. It is not mapped to memory, so that
/// what has been read does not stay resident.
class ByteSource
{
public:
    /// @param file  a file, a pipe, or "-" for stdin. @throws IoError saying why it cannot be read.
    ByteSource(const std::filesystem::path& file, Interrupter& progress);
    ~ByteSource();
    ByteSource(const ByteSource&) = delete;
    ByteSource& operator=(const ByteSource&) = delete;

    /// The name as the user wrote it; "stdin" for "-".
    const std::string& name() const { return mName; }
    std::uint64_t size() const { return mSize; }
    /// Copy the @a bytes at @a offset. @return how many there were (fewer only at the end).
    std::size_t readSome(std::uint64_t offset, char* to, std::size_t bytes) const;
    /// Copy exactly @a bytes. @throws InputError if the input ends before.
    void read(std::uint64_t offset, char* to, std::size_t bytes) const;
    /// The first @a bytes, or all there are.
    std::string head(std::size_t bytes) const;
    /// The meaning of commas in its text, set by the first reader of lines that can decide.
    Commas commas() const { return mCommas.load(std::memory_order_relaxed); }
    void setCommas(Commas commas) const { mCommas.store(commas, std::memory_order_relaxed); }
    /// What groups the digits of a table, in the same way.
    Groups groups() const { return mGroups.load(std::memory_order_relaxed); }
    void setGroups(Groups groups) const { mGroups.store(groups, std::memory_order_relaxed); }

private:
    void readPipe(Interrupter& progress);

    std::string mName;
    std::vector<std::unique_ptr<char[]>> mPiped; ///< a pipe's bytes, in pieces
    std::uint64_t mSize = 0;
    int mFile = -1;
    bool mIsPipe = false;
    mutable std::atomic<Commas> mCommas{Commas::Unknown};
    mutable std::atomic<Groups> mGroups{Groups::Unknown};
};

/// Walks through binary data that has no fixed stride.
class ByteCursor
{
public:
    ByteCursor(const ByteSource& source, std::uint64_t offset);
    /// The next @a bytes in one piece, valid until the next call. @throws InputError at the end.
    const char* take(std::size_t bytes);
    std::uint64_t offset() const { return mBase + mAt; }
    std::uint64_t remaining() const { return mSource.size() - offset(); }

private:
    void refill(std::size_t bytes);

    const ByteSource& mSource;
    std::vector<char> mBuffer;
    std::uint64_t mBase; ///< offset of the buffer's first byte
    std::size_t mAt = 0, mEnd = 0;
};

} // namespace mpuvdb
