// The lines of a text input: one by one, or in batches that threads parse side by side.
#pragma once
#include "byte_source.h"
#include <mpuvdb/interrupter.h>

#include <cstring>
#include <exception>
#include <string_view>
#include <tbb/parallel_for.h>
#include <vector>

namespace mpuvdb
{

/// Whole lines, valid until the reader's next call.
struct LineBatch {
    const char* begin = nullptr;
    const char* end = nullptr;
    char newline = '\n';
    std::uint64_t firstLine = 1; ///< number of the first line in its file
    std::size_t lines = 0;       ///< lines that are not blank
};

/// Reads lines that end in LF, CRLF or, in files that have no LF, CR. Holds one piece of the input.
/// Decimal commas become points, so that the readers of all formats see the same numbers, and the
/// separators of thousands in a table's numbers go.
class LineReader
{
public:
    /// @throws InputError, as all that reads on, where the meaning of commas is not clear.
    explicit LineReader(const ByteSource& source, std::uint64_t offset = 0,
                        std::uint64_t linesBefore = 0);
    /// Reads a table, a number's digits in groups or not.
    static LineReader ofTable(const ByteSource& source) { return {source, 0, 0, true}; }
    /// The next line that is not blank, without its end; valid until the next call.
    /// @return false at the end of the input.
    bool next(std::string_view& line);
    /// Number of the last line of next(), from 1.
    std::uint64_t line() const { return mLine; }
    /// Offset of the byte after the lines read so far.
    std::uint64_t offset() const { return mBase + mAt; }
    /// Batches, for parallel work, of some of the next @a maxLines lines that are not blank; none
    /// at the end.
    std::vector<LineBatch> nextBatches(std::uint64_t maxLines);

private:
    LineReader(const ByteSource& source, std::uint64_t offset, std::uint64_t linesBefore,
               bool isTable);
    /// @param whole  take the line only if it is all in the buffer, which then does not move.
    bool nextLine(const char*& begin, const char*& end, bool whole = false);
    bool refill();
    std::string_view wholeLines() const;
    void addGroupEvidence(std::string_view lines);
    void detectGroups();
    void detectCommas();
    [[noreturn]] void throwAmbiguousCommas(std::string_view row) const;
    void takeLine(std::size_t bytes, const char*& begin, const char*& end);

    const ByteSource& mSource;
    std::vector<char> mBuffer;
    std::uint64_t mBase;
    std::size_t mAt = 0, mEnd = 0;
    std::uint64_t mLine;
    char mNewline = '\n';
    bool mDecimalCommas = false;
    bool mIsTable = false, mDropsGroups = false;
    GroupEvidence mGroupEvidence;
};

/// Call f(line, number) for every line of @a batch that is not blank.
template <class F>
void forEachLine(const LineBatch& batch, F&& f)
{
    std::uint64_t number = batch.firstLine;
    for (const char* at = batch.begin; at < batch.end; ++number) {
        const void* found = std::memchr(at, batch.newline, std::size_t(batch.end - at));
        const char* end = found ? static_cast<const char*>(found) : batch.end;
        const std::string_view line(at, std::size_t(end - at));
        if (line.find_first_not_of(" \t\r") != std::string_view::npos) f(line, number);
        at = end + 1;
    }
}

/// Parse up to @a maxLines lines with parse(batch, Result&), in parallel, and hand each Result to
/// merge(Result&&) in the input's order. Of several errors the first in the input is thrown.
/// @return number of lines parsed.
template <class Result, class Parse, class Merge>
std::uint64_t parseLines(LineReader& reader, std::uint64_t maxLines, Interrupter& progress,
                         const Parse& parse, Merge&& merge)
{
    std::uint64_t parsed = 0;
    while (parsed < maxLines) {
        const std::vector<LineBatch> batches = reader.nextBatches(maxLines - parsed);
        if (batches.empty()) break;
        std::vector<Result> results(batches.size());
        std::vector<std::exception_ptr> errors(batches.size());
        tbb::parallel_for(std::size_t(0), batches.size(), [&](std::size_t i) {
            try {
                parse(batches[i], results[i]);
                progress.advance(double(batches[i].end - batches[i].begin));
            } catch (...) {
                errors[i] = std::current_exception();
            }
        });
        for (std::size_t i = 0; i < batches.size(); ++i) {
            if (errors[i]) std::rethrow_exception(errors[i]);
            merge(std::move(results[i]));
            parsed += batches[i].lines;
        }
    }
    return parsed;
}

} // namespace mpuvdb
