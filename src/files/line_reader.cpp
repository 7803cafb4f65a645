#include "line_reader.h"

#include "text_scan.h"
#include <mpuvdb/error.h>

#include <algorithm>
#include <fmt/format.h>

namespace mpuvdb
{
namespace
{

/// Least bytes of one read, and bytes of one batch of lines. [free: time against memory]
constexpr std::size_t kReadBytes = std::size_t(4) << 20;
constexpr std::size_t kBatchBytes = std::size_t(256) << 10;
/// Most rows with commas that are looked at. [derived: decimal commas without another separator
/// show by a fraction's leading zero, which a row of three numbers lacks with probability 0.9^3,
/// and all these rows with 1e-137]
constexpr std::size_t kMaxEvidenceRows = 1000;

bool isBlank(const char* begin, const char* end)
{
    return std::all_of(begin, end, [](char c) { return c == ' ' || c == '\t' || c == '\r'; });
}

bool isSaid(Groups groups)
{
    return groups == Groups::Dots || groups == Groups::Commas || groups == Groups::Blanks;
}

} // namespace

LineReader::LineReader(const ByteSource& source, std::uint64_t offset, std::uint64_t linesBefore)
    : LineReader(source, offset, linesBefore, false)
{
}

LineReader::LineReader(const ByteSource& source, std::uint64_t offset, std::uint64_t linesBefore,
                       bool isTable)
    : mSource(source), mBase(offset), mLine(linesBefore), mIsTable(isTable)
{
    refill();
    constexpr std::string_view kByteOrderMark = "\xef\xbb\xbf";
    if (offset == 0 &&
        std::string_view(mBuffer.data(), std::min<std::size_t>(mEnd, 3)) == kByteOrderMark)
        mAt = kByteOrderMark.size();
    const auto begin = mBuffer.begin(), end = begin + std::ptrdiff_t(mEnd);
    if (std::find(begin, end, '\n') == end && std::find(begin, end, '\r') != end) mNewline = '\r';
    detectGroups();
    detectCommas();
}

// The lines in the buffer that end in it.
std::string_view LineReader::wholeLines() const
{
    const std::string_view piece(mBuffer.data() + mAt, mEnd - mAt);
    const bool isLast = mBase + mEnd >= mSource.size();
    return piece.substr(0, isLast ? piece.size() : piece.rfind(mNewline) + 1); // none: 0
}

// The first rows; those from the next point on, of which there is none for long where all is whole;
// and some of the others.
void LineReader::addGroupEvidence(std::string_view lines)
{
    const auto addRows = [&](std::size_t at, std::size_t step) {
        for (std::size_t rows = 0; rows < kMaxEvidenceRows && at < lines.size(); ++rows) {
            const std::size_t after = std::min(lines.find(mNewline, at), lines.size());
            mGroupEvidence.add(lines.substr(at, after - at));
            const std::size_t next = std::max(after, at + step);
            at = std::min(lines.find(mNewline, next), lines.size()) + 1;
        }
        return std::min(at, lines.size());
    };
    const std::size_t read = addRows(0, 0);
    const std::size_t point = std::min(lines.find('.', read), lines.size());
    const std::size_t pointed = addRows(std::max(read, lines.rfind(mNewline, point) + 1), 0);
    addRows(pointed < lines.size() ? pointed : read, (lines.size() - read) / kMaxEvidenceRows + 1);
}

// Rows before the decision were read as if there were no groups: they have to be the same.
void LineReader::detectGroups()
{
    if (!mIsTable) return;
    const std::string_view lines = wholeLines();
    if (mSource.groups() == Groups::Unknown) {
        const bool wereThere = mGroupEvidence.any();
        addGroupEvidence(lines);
        const auto groups = mGroupEvidence.decide();
        if (!groups || (isSaid(*groups) && wereThere))
            throw InputError(fmt::format(
                "{}: {}: it is not clear whether its dots or blanks separate thousands. Export the "
                "file without separators of thousands.",
                mSource.name(), inQuotes(mGroupEvidence.example())));
        mSource.setGroups(*groups);
    }
    mDropsGroups = mDropsGroups || isSaid(mSource.groups()) || hasGroupMarks(lines);
}

// Each piece is searched until the meaning is decided: text without commas reads the same.
void LineReader::detectCommas()
{
    mDecimalCommas = mSource.commas() == Commas::Decimal;
    if (mSource.commas() != Commas::Unknown) return;
    const std::string_view piece = wholeLines();
    const std::size_t end = piece.size();
    CommaEvidence evidence;
    std::string_view firstRow;
    for (std::size_t at = piece.find(','); at < end && evidence.rows() < kMaxEvidenceRows;) {
        const std::size_t begin = at == 0 ? 0 : piece.rfind(mNewline, at - 1) + 1;
        const std::size_t after = std::min(piece.find(mNewline, at), end);
        const std::size_t before = evidence.rows();
        std::string row(piece.substr(begin, after - begin));
        if (mDropsGroups) dropGroups(row.data(), row.data() + row.size(), mSource.groups());
        evidence.add(row);
        if (before == 0 && evidence.rows() > 0) firstRow = piece.substr(begin, after - begin);
        at = piece.find(',', after);
    }
    const auto commas = evidence.decide();
    if (!commas) throwAmbiguousCommas(firstRow);
    const bool onlySeparate = *commas == Commas::Unknown && evidence.rows() == kMaxEvidenceRows;
    mSource.setCommas(onlySeparate ? Commas::Separate : *commas);
    mDecimalCommas = *commas == Commas::Decimal;
}

void LineReader::throwAmbiguousCommas(std::string_view row) const
{
    const char* const first = mBuffer.data() + mAt;
    const auto number = mLine + 1 + std::uint64_t(std::count(first, row.data(), mNewline));
    throw InputError(
        fmt::format("{}: line {}: {}: it is not clear whether commas are decimal commas, separate "
                    "thousands, or separate numbers. Export the file with decimal points and "
                    "without separators of thousands, or with ';' between the columns.",
                    mSource.name(), number, inQuotes(row)));
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
        mEnd + std::size_t(std::min<std::uint64_t>(left, std::max(kReadBytes, mEnd)));
    if (mBuffer.size() < wanted) mBuffer.resize(wanted);
    const std::size_t got = mSource.readSome(mBase + mEnd, mBuffer.data() + mEnd, wanted - mEnd);
    mEnd += got;
    return got > 0;
}

void LineReader::takeLine(std::size_t bytes, const char*& begin, const char*& end)
{
    char* const line = mBuffer.data() + mAt;
    if (mDropsGroups && !dropGroups(line, line + bytes, mSource.groups()))
        throw InputError(
            fmt::format("{}: line {}: {} has decimal points, and dots separate thousands in the "
                        "rows before. Export the file without separators of thousands.",
                        mSource.name(), mLine + 1, inQuotes({line, bytes})));
    if (mDecimalCommas) commasToPoints(line, line + bytes);
    begin = line;
    end = line + bytes;
    mAt = std::min(mAt + bytes + 1, mEnd);
    ++mLine;
}

bool LineReader::nextLine(const char*& begin, const char*& end, bool whole)
{
    std::size_t searched = 0;
    for (;;) {
        const char* start = mBuffer.data() + mAt;
        const std::size_t left = mEnd - mAt;
        const void* found =
            left > searched ? std::memchr(start + searched, mNewline, left - searched) : nullptr;
        if (found) {
            takeLine(std::size_t(static_cast<const char*>(found) - start), begin, end);
            return true;
        }
        if (whole) return false;
        searched = left;
        if (refill()) {
            detectGroups();
            detectCommas();
            continue;
        }
        if (left == 0) return false;
        takeLine(left, begin, end);
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
        more = nextLine(begin, end, /*whole=*/true);
    }
    return batches;
}

} // namespace mpuvdb
