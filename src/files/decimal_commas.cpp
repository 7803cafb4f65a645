#include "decimal_commas.h"

#include "number_parts.h"
#include "text_scan.h"

#include <algorithm>

namespace mpuvdb
{
namespace
{

/// Whether @a c separates fields whatever commas mean.
bool isGap(char c)
{
    return c != ',' && (isSeparator(c) || c == '"');
}

/// The characters before and after a place in a line, blanks at its ends.
char before(std::string_view line, std::size_t at)
{
    return at > 0 ? line[at - 1] : ' ';
}
char after(std::string_view line, std::size_t at)
{
    return at + 1 < line.size() ? line[at + 1] : ' ';
}

bool partsAtGap(std::string_view line, std::size_t at)
{
    const char a = before(line, at), b = after(line, at);
    return isGap(a) || a == ',' || isGap(b) || b == ',';
}

bool isNumeric(std::string_view text)
{
    const bool allowed = text.find_first_not_of("0123456789+-.,eEdD") == std::string_view::npos;
    return allowed && text.find_first_of("0123456789") != std::string_view::npos &&
           text.find_first_of("eEdD") != 0;
}

/// Whether @a text is like 1,5 or -,5 or 1,5e+03.
bool isDecimal(std::string_view text)
{
    NumberParts parts(text);
    parts.digits();
    return parts.mark(',') && !parts.digits().empty() && parts.ends();
}

bool beginsWithZero(std::string_view digits)
{
    return digits.size() > 1 && digits.front() == '0';
}

} // namespace

void CommaEvidence::Counts::add(std::size_t count)
{
    least = std::min(least, count);
    most = std::max(most, count);
}

CommaEvidence::Row CommaEvidence::split(std::string_view line)
{
    line = line.substr(0, std::min(line.find('#'), line.find("//")));
    Row row;
    Field field;
    for (std::size_t at = 0; at < line.size();) {
        if (isGap(line[at]) || (line[at] == ',' && partsAtGap(line, at))) {
            if (line[at] == '"') field.quoted = !field.quoted;
            field.byComma |= line[at] == ',';
            row.leading |= line[at] == ',' && isSeparator(before(line, at)) &&
                           before(line, at) != ',' && isDigit(after(line, at));
            ++at;
            continue;
        }
        const std::size_t begin = at;
        while (at < line.size() && !isGap(line[at]) && !(line[at] == ',' && partsAtGap(line, at)))
            ++at;
        field.text = line.substr(begin, at - begin);
        if (isNumeric(field.text))
            row.numbers.push_back(field);
        else
            row.words |= row.numbers.empty();
        field.byComma = false;
    }
    return row;
}

void CommaEvidence::add(std::string_view line)
{
    const Row row = split(line);
    std::size_t inner = 0;
    for (const Field& field : row.numbers)
        inner += std::size_t(std::count(field.text.begin(), field.text.end(), ','));
    if (row.numbers.size() + inner < 3) return;
    // After a word a list alone may be a name: unless it can be no list.
    if (row.words && row.numbers.size() == 1 && !addPairs(row.numbers.front().text)) return;
    ++mRows;
    mInner |= inner > 0;
    mIfDecimal.add(row.numbers.size());
    mIfSeparate.add(row.numbers.size() + inner);
    if (inner == 0) return;
    mLeading |= row.leading;
    for (std::size_t n = 1; n < row.numbers.size(); ++n)
        (row.numbers[n].byComma ? mByComma : mBare) = true;
    for (const Field& field : row.numbers) addNumber(field);
}

void CommaEvidence::addNumber(const Field& field)
{
    const std::string_view text = field.text;
    const bool hasPoint = text.find('.') != std::string_view::npos;
    const bool grouped = isGrouped(text, '.', ',');
    if (text.find(',') == std::string_view::npos) {
        mDecimal = mDecimal && !hasPoint;
        mEuropean = mEuropean && (!hasPoint || grouped);
        mSmallWhole |= !hasPoint && text.find_first_of("123456789") != std::string_view::npos;
        return;
    }
    mMustBePairs |= addPairs(text);
    const bool decimal = isDecimal(text), thousands = isGrouped(text, ',', '.');
    mQuoted = mQuoted && field.quoted;
    mDecimal = mDecimal && decimal;
    mThousands = mThousands && thousands;
    mEuropean = mEuropean && (decimal || grouped);
    mList |= !decimal && !thousands && !grouped;
}

bool CommaEvidence::addPairs(std::string_view list)
{
    bool must = false;
    for (std::size_t part = 0; mPairs && !list.empty(); ++part) {
        const std::string_view text = list.substr(0, list.find(','));
        list.remove_prefix(std::min(text.size() + 1, list.size()));
        NumberParts parts(text);
        const std::string_view digits = parts.digits();
        const bool isFraction = part % 2 == 1;
        const bool isWhole = digits.size() == text.size() - (isSign(text.front()) ? 1 : 0);
        mPairs = !digits.empty() && parts.ends() && (isFraction || isWhole) &&
                 !(isFraction ? isSign(text.front()) : beginsWithZero(digits));
        must |= isFraction ? beginsWithZero(digits) || !isWhole : isSign(text[0]) && digits == "0";
    }
    return must && mPairs;
}

std::optional<Commas> CommaEvidence::decide() const
{
    using Meaning = std::optional<Commas>;
    if (!mInner) return Commas::Unknown;
    const Meaning elseLists = mList ? Meaning(Commas::Separate) : std::nullopt;
    if (mBare) {
        // 1,234 567 may be thousands; where every number is like 1,234 the shape is the same.
        const bool fits = mDecimal && !mLeading && !(mThousands && mSmallWhole);
        return fits ? Commas::Decimal : elseLists;
    }
    if (mQuoted) return mDecimal ? Commas::Decimal : elseLists;
    if (!mByComma) {
        const bool pairs = mPairs && mMustBePairs && mIfSeparate.areTable() &&
                           mIfSeparate.least >= 6 && mIfSeparate.least % 2 == 0;
        return pairs ? std::nullopt : Meaning(Commas::Separate);
    }
    const bool possible = mDecimal || mThousands || mEuropean;
    if (!possible || !mIfDecimal.areTable()) return Commas::Separate;
    const bool certain = mDecimal && !mLeading && (mMustBePairs || !mIfSeparate.areTable());
    return certain ? Meaning(Commas::Decimal) : std::nullopt;
}

void commasToPoints(char* begin, char* end)
{
    const std::string_view line(begin, std::size_t(end - begin));
    const std::size_t first = line.find_first_not_of(" \t\",;");
    const bool isRow = first != std::string_view::npos &&
                       (isDigit(line[first]) || isSign(line[first]) || line[first] == '.');
    for (std::size_t at = 0; at < line.size(); ++at) {
        const bool inside = isDigit(before(line, at)) || isSign(before(line, at));
        if (line[at] == ',' && inside && isDigit(after(line, at))) begin[at] = '.';
        if (line[at] == '"' && isRow) begin[at] = ' ';
    }
}

} // namespace mpuvdb
