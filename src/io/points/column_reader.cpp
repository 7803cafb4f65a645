// XYZ, PTS, PWN, TXT, CSV: one point per line, with headers and comments.
#include "column_names.h"
#include "files/line_reader.h"
#include "files/text_scan.h"
#include "leading_columns.h"
#include "readers.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>

#include <algorithm>
#include <limits>

namespace mpuvdb
{
namespace
{

/// The rows whose values decide the meaning of columns. [tuned: io_read_test]
constexpr std::size_t kSampleRows = 1000;

// The header of the file.
struct Preamble {
    ColumnLayout layout;
    AttributeSet has;
    bool tagged = false;   ///< points are lines "p x y z", others are not points
    bool hasCount = false; ///< the first line is the number of points
    std::uint64_t count = 0;
    std::uint64_t nameLine = 0; ///< number of the line of names; 0: none
    char separator = 0;         ///< of rows that have a field for each name; 0: any
    ColumnNames comment;        ///< before the first row, the last one of words
    ColumnNames words;          ///< a first line of words, none of them a position
    std::string wordLine, firstRow;
    std::uint64_t rowLine = 0; ///< number of the first row's line; 0: it is not known yet
    std::string leading;       ///< a note about the columns before x; empty: there are none
};

struct Rows {
    PointBlock points;
    std::uint64_t counted = 0; ///< points announced by lines of a single number
};

bool isTag(std::string_view word)
{
    return word.size() == 1 && word.front() >= 'a' && word.front() <= 'z';
}

/// Reader of the values of @a row without the quotes around each of them, for which @a unquoted is
/// the room; with them where more than one number or word is within.
LineScanner scanRow(std::string_view row, std::string& unquoted)
{
    if (row.find('"') == std::string_view::npos) return LineScanner(row);
    unquoted = row;
    for (;;) {
        const std::size_t open = unquoted.find('"');
        if (open == std::string::npos) return LineScanner(unquoted);
        const std::size_t close = std::min(unquoted.find('"', open + 1), unquoted.size());
        LineScanner inside(std::string_view(unquoted).substr(open + 1, close - open - 1));
        if (close == unquoted.size() || inside.word().empty() || !inside.atEnd())
            return LineScanner(row);
        unquoted[open] = unquoted[close] = ' ';
    }
}

/// Reads a number, or NaN for what marks in tables that there is none.
bool readValue(LineScanner& scan, double& value)
{
    LineScanner ahead = scan;
    if (scan.number(value)) return true;
    const std::string word = lowerCase(ahead.word());
    value = std::numeric_limits<double>::quiet_NaN();
    return word == "-" || word == "na" || word == "n/a" || word == "null" || word == "none";
}

class ColumnReader
{
public:
    ColumnReader(const ByteSource& source, ColumnOrder order, const ScalarNames& scalars,
                 Interrupter& progress)
        : mSource(source), mOrder(order), mScalars(scalars), mProgress(progress)
    {
    }

    FilePoints read()
    {
        readPreamble();
        FilePoints result;
        std::uint64_t counted = 0;
        LineReader lines = LineReader::ofTable(mSource);
        parseLines<Rows>(
            lines, std::numeric_limits<std::uint64_t>::max(), mProgress,
            [&](const LineBatch& batch, Rows& rows) {
                rows.points.reserve(batch.lines, mBegin.has);
                forEachLine(batch, [&](std::string_view line, std::uint64_t number) {
                    parseLine(line, number, rows);
                });
            },
            [&](Rows&& rows) {
                counted += rows.counted;
                if (rows.points.size() > 0) result.blocks.push_back(std::move(rows.points));
            });
        for (std::size_t c = 0; c < mBegin.layout.names.size(); ++c)
            if (isNamedScalar(mBegin.layout.columns[c]) && !mBegin.layout.names[c].empty())
                result.scalarNames.push_back(mBegin.layout.names[c]);
        if (!mBegin.leading.empty()) result.notes.push_back(mBegin.leading);
        if (mBegin.hasCount) compareCount(result, counted);
        return result;
    }

private:
    [[noreturn]] void throwBad(std::uint64_t number, std::string_view line,
                               const std::string& what) const
    {
        throw InputError(fmt::format("{}: line {}: {} {}. Export the file as numbers in columns.",
                                     mSource.name(), number, inQuotes(line), what));
    }

    void readPreamble()
    {
        LineReader lines = LineReader::ofTable(mSource);
        std::vector<std::vector<double>> sample;
        std::string_view line;
        bool first = true;
        while (sample.size() < kSampleRows && lines.next(line)) {
            if (isComment(line, lines.line())) {
                if (sample.empty() && mBegin.nameLine == 0) readComment(line, lines.line());
                continue;
            }
            LineScanner ahead(line);
            const bool tagged = isTag(ahead.word()) && (first || mBegin.tagged);
            if (first && readFirstLine(line, lines.line())) {
                first = false;
                continue;
            }
            mBegin.tagged = mBegin.tagged || tagged;
            first = false;
            takeSample(line, lines.line(), sample);
        }
        chooseLayout(sample);
    }

    /// Whether a line is a comment. One of ';', '%' or '!' goes on with something else than a row
    /// of numbers, and is no list of names; where rows may begin with it, it stands before them.
    bool isComment(std::string_view line, std::uint64_t number) const
    {
        if (LineScanner(line).atEndOrComment()) return true;
        const char mark = line[line.find_first_not_of(" \t")];
        if (mark != ';' && mark != '%' && mark != '!') return false;
        const std::uint64_t table = mBegin.nameLine > 0 ? mBegin.nameLine : mBegin.rowLine;
        const bool rowsMayBeginSo =
            mark == ';' ? mBegin.separator == ';' || mBegin.firstRow.find(';') != std::string::npos
                        : mBegin.separator != 0;
        if (table > 0 && number > table && rowsMayBeginSo) return false;
        double value = 0;
        std::string unquoted;
        LineScanner row = scanRow(line, unquoted);
        while (!row.atEndOrComment())
            if (!row.number(value)) return !listsPositions(line);
        return false;
    }

    /// Whether a line is a list of names, positions among them, which something else than blanks
    /// parts.
    bool listsPositions(std::string_view line) const
    {
        const ColumnNames list = columnNames(line, 0);
        return list.separator != ' ' &&
               layoutFromNames(line, mScalars).columns.size() == list.names.size();
    }

    // Reads a comment before the rows: some programs write names as one.
    void readComment(std::string_view line, std::uint64_t number)
    {
        const ColumnLayout named = layoutFromNames(line, mScalars);
        if (!named.columns.empty()) mBegin.layout = named;
        const bool saysSomething = std::any_of(line.begin(), line.end(), [](char c) {
            return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
        });
        if (saysSomething) mBegin.comment = columnNames(line, number);
    }

    // Reads a line of names, or of the number of points.
    bool readFirstLine(std::string_view line, std::uint64_t number)
    {
        const ColumnLayout named = layoutFromNames(line, mScalars);
        if (!named.columns.empty()) {
            mBegin.layout = named;
            mBegin.nameLine = number;
            const char separator = columnNames(line, number).separator;
            mBegin.separator = separator == ' ' ? '\0' : separator;
            return true;
        }
        mBegin.words = columnNames(line, number);
        mBegin.wordLine = line;
        if (mBegin.words.areWords()) return true;
        mBegin.words = {};
        LineScanner scan(line);
        std::int64_t count = 0;
        mBegin.hasCount = scan.integer(count) && count >= 0 && scan.atEndOrComment();
        if (mBegin.hasCount) mBegin.count = std::uint64_t(count);
        return mBegin.hasCount;
    }

    void takeSample(std::string_view line, std::uint64_t number,
                    std::vector<std::vector<double>>& sample)
    {
        std::string unquoted;
        LineScanner scan = scanRow(line, unquoted);
        if (mBegin.tagged && scan.word() != "p") return;
        std::vector<double> row;
        if (sample.empty()) {
            mBegin.separator = separatorOfFields(line);
            mBegin.firstRow = line;
            mBegin.rowLine = number;
        }
        if (mBegin.separator) {
            parseFields(line, number, [&](std::size_t, double value) { row.push_back(value); });
            sample.push_back(std::move(row));
            return;
        }
        double value = 0;
        while (!scan.atEndOrComment()) {
            if (!readValue(scan, value)) throwBad(number, line, "is not a row of numbers");
            row.push_back(value);
        }
        if (row.size() == 1 && mBegin.hasCount) return;
        if (row.size() < 3) throwBad(number, line, "has fewer than three numbers");
        if (sample.empty() || row.size() == sample.front().size()) sample.push_back(std::move(row));
    }

    /// The names' separator, if it makes as many fields of the first row; else 0.
    char separatorOfFields(std::string_view row) const
    {
        if (!mBegin.separator) return 0;
        FieldScanner scan(row, mBegin.separator);
        std::string_view field;
        std::size_t fields = 0;
        while (scan.next(field)) ++fields;
        return fields == mBegin.layout.columns.size() ? mBegin.separator : '\0';
    }

    /// Calls @a put(column, value) for the fields of a row; 0 for unused ones, which may be text.
    template <class Put>
    void parseFields(std::string_view line, std::uint64_t number, const Put& put) const
    {
        const std::vector<Attribute>& columns = mBegin.layout.columns;
        FieldScanner scan(line, mBegin.separator);
        std::string_view field;
        std::size_t column = 0;
        for (; column < columns.size() && scan.next(field); ++column) {
            double value = 0;
            LineScanner text(field);
            const bool isRead = columns[column] != Attribute::None;
            if (isRead && !(readValue(text, value) && text.atEndOrComment()))
                throwBad(number, line,
                         fmt::format("has {} in column {}, where a number has to be",
                                     field.empty() ? "nothing" : inQuotes(field), column + 1));
            put(column, value);
        }
        if (column < columns.size())
            throwBad(number, line,
                     fmt::format("has {} fields where others have {}: the file is truncated or "
                                 "damaged",
                                 column, columns.size()));
        if (scan.next(field) && !field.empty())
            throwBad(number, line, fmt::format("has more fields than the {} of others", column));
    }

    void chooseLayout(const std::vector<std::vector<double>>& sample)
    {
        const std::size_t columns = sample.empty() ? 0 : sample.front().size();
        if (!mBegin.words.names.empty()) {
            if (mBegin.words.names.size() == columns)
                throwNoPositions(mSource.name(), mBegin.words);
            throwBad(mBegin.words.line, mBegin.wordLine, "is not a row of numbers");
        }
        if (sample.empty())
            throw InputError(
                fmt::format("{}: holds no points. Check what was exported.", mSource.name()));
        if (mBegin.layout.columns.size() != columns) {
            refuseOtherColumns(columns);
            const bool named = !mBegin.layout.columns.empty(); // x, y and z the first
            const std::vector<Attribute> leading =
                named ? std::vector<Attribute>() : leadingColumns(sample);
            mBegin.layout = layoutFromValues(sample, mOrder, leading);
        }
        mBegin.has = AttributeSet(mBegin.layout.columns);
        mBegin.has.colors = mBegin.has.colors && !mBegin.has.packedRgb;
        mBegin.has.packedRgb = mBegin.has.byteColors = false;
    }

    /// The meaning of each column before x.
    std::vector<Attribute> leadingColumns(const std::vector<std::vector<double>>& sample)
    {
        std::vector<Attribute> leading;
        for (;;) {
            const std::size_t column = leading.size();
            Leading meaning = leadingColumn(sample, column);
            if (sample.size() == kSampleRows && mayChange(meaning, sample, column))
                meaning = leadingColumn(firstRows(kRisingRows), column);
            if (hasToRise(meaning) && !risesOn(column)) meaning = leadingIfItFalls(meaning);
            if (const std::string why = whyUnclear(meaning, column); !why.empty())
                throw InputError(fmt::format("{}: {}", mSource.name(), why));
            if (meaning == Leading::Coordinate) {
                if (column > 0)
                    mBegin.leading += fmt::format(": x, y and z are columns {}, {} and {}",
                                                  column + 1, column + 2, column + 3);
                return leading;
            }
            mBegin.leading += (column == 0 ? "" : ", ") + whatItIs(meaning, column);
            if (meaning == Leading::Normals)
                leading.insert(leading.end(),
                               {Attribute::NormalX, Attribute::NormalY, Attribute::NormalZ});
            else
                leading.push_back(Attribute::None);
        }
    }

    /// The first rows, at most @a most, that are as long as the first.
    std::vector<std::vector<double>> firstRows(std::size_t most)
    {
        LineReader lines = LineReader::ofTable(mSource);
        std::vector<std::vector<double>> rows;
        std::string_view line;
        while (rows.size() < most && lines.next(line)) {
            if ((lines.line() & 0xfff) == 0) mProgress.check();
            if (!isComment(line, lines.line())) takeSample(line, lines.line(), rows);
        }
        return rows;
    }

    /// Whether a column rises in all of the first rows.
    bool risesOn(std::size_t column) const
    {
        LineReader lines = LineReader::ofTable(mSource);
        std::string_view line;
        std::string unquoted;
        double before = -std::numeric_limits<double>::infinity();
        for (std::size_t rows = 0; rows < kRisingRows && lines.next(line);) {
            if ((lines.line() & 0xfff) == 0) mProgress.check();
            LineScanner scan = scanRow(line, unquoted);
            if (isComment(line, lines.line()) || (mBegin.tagged && scan.word() != "p")) continue;
            double value = 0;
            std::size_t read = 0;
            while (read <= column && readValue(scan, value)) ++read;
            if (read <= column || scan.atEndOrComment()) continue; // the number of points
            if (!(value > before)) return false;
            before = value;
            ++rows;
        }
        return true;
    }

    // Refuses names that do not fit the columns.
    void refuseOtherColumns(std::size_t columns) const
    {
        const std::size_t named = mBegin.layout.columns.size();
        if (commentNamesColumns(mBegin.comment, mBegin.firstRow, columns))
            throwNoPositions(mSource.name(), mBegin.comment);
        const std::vector<Attribute>& layout = mBegin.layout.columns;
        const bool namesFirst = named >= 3 && layout[0] == Attribute::X &&
                                layout[1] == Attribute::Y && layout[2] == Attribute::Z;
        if (mBegin.nameLine > 0 && !namesFirst)
            throw InputError(fmt::format("{}: line {} names {} columns, x, y and z not the first, "
                                         "and rows have {} numbers. Export it with a name for "
                                         "every column.",
                                         mSource.name(), mBegin.nameLine, named, columns));
        if (mBegin.nameLine > 0 && columns == 2 * named && mSource.commas() == Commas::Separate)
            throw InputError(fmt::format("{}: line {} names {} columns, and rows have twice as "
                                         "many numbers: their commas seem to be decimal commas. "
                                         "Export it with decimal points.",
                                         mSource.name(), mBegin.nameLine, named));
    }

    void parseLine(std::string_view line, std::uint64_t number, Rows& rows) const
    {
        if (number == mBegin.nameLine || isComment(line, number)) return;
        RowValues row{};
        if (mBegin.separator) {
            parseFields(line, number, [&](std::size_t column, double value) {
                const Attribute attribute = mBegin.layout.columns[column];
                if (attribute != Attribute::None) row[std::size_t(attribute)] = value;
            });
            rows.points.append(row, mBegin.has);
            return;
        }
        std::string unquoted;
        LineScanner scan = scanRow(line, unquoted);
        if (mBegin.tagged && scan.word() != "p") return;
        std::size_t column = 0;
        for (; column < mBegin.layout.columns.size() && !scan.atEndOrComment(); ++column) {
            double value = 0;
            if (!readValue(scan, value)) throwBad(number, line, "is not a row of numbers");
            const Attribute attribute = mBegin.layout.columns[column];
            if (attribute == Attribute::None) continue;
            row[std::size_t(attribute)] = value;
        }
        if (column == 1 && mBegin.hasCount && row[0] >= 0 && row[0] < 1e15) {
            rows.counted += std::uint64_t(row[0]);
            return;
        }
        if (column < mBegin.layout.columns.size())
            throwBad(number, line,
                     fmt::format("has {} numbers where others have {}: the file is truncated or "
                                 "damaged, or its commas are decimal commas",
                                 column, mBegin.layout.columns.size()));
        if (!scan.atEndOrComment())
            throwBad(number, line,
                     fmt::format("has more numbers than the {} of others: the file is damaged, or "
                                 "its commas are decimal commas",
                                 column));
        rows.points.append(row, mBegin.has);
    }

    // Compares with the announced number; in some formats as many triples again are normals, in
    // order.
    void compareCount(FilePoints& result, std::uint64_t counted) const
    {
        const std::uint64_t found = result.size();
        if (found < counted)
            throw InputError(fmt::format("{}: promises {} points, but {} follow: the file is "
                                         "truncated. Copy or export it again.",
                                         mSource.name(), counted, found));
        const bool areNormalsBehind = mOrder == ColumnOrder::NormalsLast &&
                                      mBegin.layout.columns.size() == 3 && counted > 0 &&
                                      counted == mBegin.count && found == 2 * counted;
        if (!areNormalsBehind) {
            if (found > counted)
                result.notes.push_back(
                    fmt::format("its header says {} points, and {} are there, which all were read",
                                counted, found));
            return;
        }
        PointBlock& block = result.joined();
        block.normals.reserve(counted);
        for (std::size_t i = counted; i < found; ++i)
            block.normals.push_back(block.positions[i].cast<float>());
        block.positions.resize(counted);
    }

    const ByteSource& mSource;
    const ColumnOrder mOrder;
    const ScalarNames& mScalars;
    Interrupter& mProgress;
    Preamble mBegin;
};

} // namespace

FilePoints readColumns(const ByteSource& source, const ScalarNames& scalars, Interrupter& progress)
{
    return ColumnReader(source, ColumnOrder::Free, scalars, progress).read();
}

FilePoints readPwn(const ByteSource& source, const ScalarNames& scalars, Interrupter& progress)
{
    return ColumnReader(source, ColumnOrder::NormalsLast, scalars, progress).read();
}

FilePoints readPts(const ByteSource& source, const ScalarNames& scalars, Interrupter& progress)
{
    return ColumnReader(source, ColumnOrder::IntensityFirst, scalars, progress).read();
}

} // namespace mpuvdb
