#include "line_reader.h"

#include <algorithm>

namespace mpuvdb
{
namespace
{

constexpr std::size_t kPiece = std::size_t(4) << 20;
constexpr std::size_t kBatchBytes = std::size_t(256) << 10;

bool isBlank(const char* begin, const char* end)
{
    return std::all_of(begin, end, [](char c) { return c == ' ' || c == '\t' || c == '\r'; });
}

} // namespace

LineReader::LineReader(const ByteSource& source, std::uint64_t offset, std::uint64_t linesBefore)
    : mSource(source), mBase(offset), mLine(linesBefore)
{
    refill();
    constexpr std::string_view kByteOrderMark = "\xef\xbb\xbf";
    if (offset == 0 &&
        std::string_view(mBuffer.data(), std::min<std::size_t>(mEnd, 3)) == kByteOrderMark)
        mAt = kByteOrderMark.size();
    const auto begin = mBuffer.begin(), end = begin + std::ptrdiff_t(mEnd);
    if (std::find(begin, end, '\n') == end && std::find(begin, end, '\r') != end) mNewline = '\r';
}

bool LineReader::refill()
{
    std::copy(mBuffer.begin() + std::ptrdiff_t(mAt), mBuffer.begin() + std::ptrdiff_t(mEnd),
              mBuffer.begin());
    mBase += mAt;
    mEnd -= mAt;
    mAt = 0;
    // A line longer than the buffer (a strip of a million triangles) makes it grow.
    const std::uint64_t left = mSource.size() - std::min(mSource.size(), mBase + mEnd);
    const std::size_t wanted =
        mEnd + std::size_t(std::min<std::uint64_t>(left, std::max(kPiece, mEnd)));
    if (mBuffer.size() < wanted) mBuffer.resize(wanted);
    const std::size_t got = mSource.readSome(mBase + mEnd, mBuffer.data() + mEnd, wanted - mEnd);
    mEnd += got;
    return got > 0;
}

bool LineReader::nextLine(const char*& begin, const char*& end)
{
    std::size_t searched = 0;
    for (;;) {
        const char* start = mBuffer.data() + mAt;
        const std::size_t left = mEnd - mAt;
        const void* found =
            left > searched ? std::memchr(start + searched, mNewline, left - searched) : nullptr;
        if (found) {
            begin = start;
            end = static_cast<const char*>(found);
            mAt += std::size_t(end - begin) + 1;
            ++mLine;
            return true;
        }
        searched = left;
        if (refill()) continue;
        if (left == 0) return false;
        begin = mBuffer.data() + mAt;
        end = begin + left;
        mAt = mEnd;
        ++mLine;
        return true;
    }
}

bool LineReader::next(std::string_view& line)
{
    const char *begin = nullptr, *end = nullptr;
    while (nextLine(begin, end)) {
        if (isBlank(begin, end)) continue;
        if (end[-1] == '\r') --end;
        line = {begin, std::size_t(end - begin)};
        return true;
    }
    return false;
}

std::vector<LineBatch> LineReader::nextBatches(std::uint64_t maxLines)
{
    std::vector<LineBatch> batches;
    const char *begin = nullptr, *end = nullptr;
    std::uint64_t taken = 0;
    // The first line may move the buffer; from then on only lines that lie in it whole are taken.
    for (bool more = nextLine(begin, end); more;) {
        if (batches.empty() || std::size_t(begin - batches.back().begin) > kBatchBytes)
            batches.push_back({begin, end, mNewline, mLine, 0});
        batches.back().end = end;
        if (!isBlank(begin, end)) {
            ++batches.back().lines;
            if (++taken == maxLines) break;
        }
        const char* start = mBuffer.data() + mAt;
        more = std::memchr(start, mNewline, mEnd - mAt) != nullptr && nextLine(begin, end);
    }
    return batches;
}

} // namespace mpuvdb
