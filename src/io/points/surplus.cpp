#include "surplus.h"

#include "files/text_scan.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

namespace mpuvdb
{

std::uint64_t rowsLeft(LineReader& lines, Interrupter& progress)
{
    std::uint64_t rows = 0;
    parseLines<std::uint64_t>(
        lines, std::numeric_limits<std::uint64_t>::max(), progress,
        [](const LineBatch& batch, std::uint64_t& found) {
            forEachLine(batch, [&](std::string_view line, std::uint64_t) {
                double ignored = 0;
                found += LineScanner(line).number(ignored);
            });
        },
        [&](std::uint64_t&& found) { rows += found; });
    return rows;
}

std::uint64_t recordsLeft(const ByteSource& source, std::uint64_t begin, std::uint64_t stride,
                          Interrupter& progress, std::uint64_t end)
{
    end = std::min(end, source.size());
    if (stride == 0 || begin >= end || end - begin < stride) return 0;
    std::vector<char> piece(std::size_t(std::min<std::uint64_t>(end - begin, 1 << 20)));
    for (std::uint64_t at = begin; at < end;) {
        progress.check();
        const std::size_t read = source.readSome(
            at, piece.data(), std::size_t(std::min<std::uint64_t>(end - at, piece.size())));
        const auto pieceEnd = piece.begin() + std::ptrdiff_t(read);
        if (std::any_of(piece.begin(), pieceEnd, [](char byte) { return byte != 0; }))
            return (end - begin) / stride;
        if (read == 0) break;
        at += read;
    }
    return 0;
}

void noteSurplus(FilePoints& points, std::uint64_t rows, const std::string& said)
{
    if (rows == 0) return;
    points.notes.push_back(
        fmt::format("its header says {}, and {} more {} left out. Correct the header if {} to it",
                    said, rows, rows == 1 ? "row follows, which is" : "rows follow, which are",
                    rows == 1 ? "it belongs" : "they belong"));
}

} // namespace mpuvdb
