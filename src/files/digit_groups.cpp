#include "digit_groups.h"

#include "number_parts.h"
#include "text_scan.h"

#include <algorithm>

namespace mpuvdb
{
namespace
{

/// Least numbers like 1.234 that all have three digits behind the dot by their groups only.
/// [derived: a number with three decimals ends with a zero, which programs leave out that write
/// whole numbers without decimals, with probability 0.1; all of 132 do not with 1e-6]
constexpr std::size_t kSureDots = 132;
/// Least numbers at which that is likelier than not to be so. [derived: all of 22 have three
/// decimals with probability 0.1]
constexpr std::size_t kLikelyDots = 22;

/// Blanks that do not break a line, and apostrophes: UTF-8, and Latin-1.
constexpr std::string_view kMarks[] = {
    "'", "\xe2\x80\x99", "\xc2\xa0", "\xe2\x80\xaf", "\xe2\x80\x89", "\xe2\x80\x87", "\xa0"};

std::string_view withoutComment(std::string_view line)
{
    return line.substr(0, std::min(line.find('#'), line.find("//")));
}

bool beginsNumber(std::string_view text)
{
    return !text.empty() && (isDigit(text.front()) || isSign(text.front()) || text.front() == '.');
}

/// Whether @a text is a number with a decimal point or none, or several dots in its place.
bool isNumber(std::string_view text)
{
    return beginsNumber(text) &&
           text.find_first_not_of("0123456789+-.eE") == std::string_view::npos &&
           text.find_first_of("0123456789") != std::string_view::npos;
}

/// Whether @a text is whole, below 1000 and without leading zeros.
bool isSmall(std::string_view text)
{
    NumberParts parts(text);
    const std::string_view digits = parts.digits();
    return !digits.empty() && digits.size() <= 3 && parts.isEmpty() &&
           (digits.front() != '0' || digits.size() == 1);
}

/// Bytes of a separator at the beginning of @a text; 0: there is none.
std::size_t markAt(std::string_view text, Groups groups)
{
    if (text.empty()) return 0;
    if (groups == Groups::Dots && text.front() == '.') return 1;
    if (groups == Groups::Blanks && text.front() == ' ') return 1;
    for (const std::string_view mark : kMarks)
        if (text.substr(0, mark.size()) == mark) return mark.size();
    return 0;
}

std::size_t digitsAt(std::string_view text)
{
    return std::min(text.find_first_not_of("0123456789"), text.size());
}

/// Whether @a text begins with a decimal point, and no date's.
bool isPoint(std::string_view text)
{
    if (text.empty() || text.front() != '.') return false;
    text.remove_prefix(1 + digitsAt(text.substr(1)));
    return text.empty() || text.front() != '.';
}

/// Bytes of a separator at the beginning of @a text with three digits behind it.
std::size_t groupAt(std::string_view text, Groups groups)
{
    const std::size_t mark = markAt(text, groups);
    return mark > 0 && digitsAt(text.substr(mark)) == 3 ? mark : 0;
}

} // namespace

void GroupEvidence::add(std::string_view line)
{
    line = withoutComment(line);
    if (mDots) addDots(line);
    if (mBlanks) addBlanks(line);
}

void GroupEvidence::noteExample(std::string_view line)
{
    if (mExample.empty()) mExample = line;
}

void GroupEvidence::addDots(std::string_view line)
{
    std::vector<std::string_view> numbers;
    bool fits = true;
    LineScanner scan(line);
    while (!scan.atEnd()) {
        std::string_view word = scan.word();
        while (!word.empty() && word.front() == '"') word.remove_prefix(1);
        while (!word.empty() && word.back() == '"') word.remove_suffix(1);
        const bool grouped = isGrouped(word, '.', ' ');
        if (!isNumber(word) || (!grouped && std::count(word.begin(), word.end(), '.') > 1))
            word = {}; // a word, or a date
        numbers.push_back(word);
        fits = fits && (word.empty() || grouped || isSmall(word));
    }
    if (std::count_if(numbers.begin(), numbers.end(), [](auto n) { return !n.empty(); }) < 3)
        return;
    for (std::size_t at = 1; at + 1 < line.size(); ++at) // as a decimal comma
        fits = fits && !(line[at] == ',' && isDigit(line[at - 1]) && isDigit(line[at + 1]));
    if (!fits) {
        mBroken = mDotted >= kSureDots && columnMixes();
        mDots = false;
        return;
    }
    if (mColumns.size() < numbers.size()) mColumns.resize(numbers.size());
    for (std::size_t c = 0; c < numbers.size(); ++c) {
        const auto dots = std::count(numbers[c].begin(), numbers[c].end(), '.');
        mTwoDots |= dots > 1;
        mDotted += dots > 0;
        mColumns[c].dotted |= dots > 0;
        mColumns[c].small |= dots == 0 && !numbers[c].empty() && numbers[c] != "0";
        if (dots > 0) noteExample(line);
    }
}

void GroupEvidence::addBlanks(std::string_view line)
{
    const auto has = [&](char c) { return std::count(line.begin(), line.end(), c) > 1; };
    const char separator = has(';') ? ';' : '\t';
    FieldScanner scan(line, separator);
    std::string_view field;
    std::size_t fields = 0, numbers = 0;
    bool fits = has(separator), blanked = false, zero = false;
    while (scan.next(field)) {
        while (!field.empty() && isSeparator(field.back())) field.remove_suffix(1);
        if (!beginsNumber(field)) continue;
        ++fields;
        const auto blanks = std::size_t(std::count(field.begin(), field.end(), ' '));
        numbers += 1 + blanks;
        if (blanks == 0) continue;
        blanked = true;
        zero |= field.find(" 0") != std::string_view::npos;
        fits = fits && (isGrouped(field, ' ', ',') || isGrouped(field, ' ', '.'));
    }
    if (numbers < 3) return;
    mBlanks = fits && fields >= 3;
    if (!mBlanks) return;
    mBlanked |= blanked;
    mZeroGroup |= zero;
    mLeast = std::min(mLeast, numbers);
    mMost = std::max(mMost, numbers);
    if (blanked) noteExample(line);
}

bool GroupEvidence::columnMixes() const
{
    return std::any_of(mColumns.begin(), mColumns.end(),
                       [](const Column& column) { return column.dotted && column.small; });
}

std::optional<Groups> GroupEvidence::decide() const
{
    if (mBroken) return std::nullopt;
    if (mBlanks && mBlanked) {
        if (mZeroGroup || mLeast < mMost) return Groups::Blanks;
        return std::nullopt;
    }
    if (mDots && (mTwoDots || (mDotted >= kSureDots && columnMixes()))) return Groups::Dots;
    if (mDots && mDotted >= kLikelyDots && columnMixes()) return std::nullopt;
    return mDots || mBlanks ? Groups::Unknown : Groups::None;
}

bool hasGroupMarks(std::string_view text)
{
    return std::any_of(std::begin(kMarks), std::end(kMarks), [&](std::string_view mark) {
        return text.find(mark) != std::string_view::npos;
    });
}

bool dropGroups(char* begin, char* end, Groups groups)
{
    const std::string_view line(begin, std::size_t(end - begin));
    const bool isRow =
        beginsNumber(line.substr(std::min(line.find_first_not_of(" \t\""), line.size())));
    char* to = begin;
    bool fit = true;
    for (std::size_t at = 0; at < line.size();) {
        const std::size_t digits = digitsAt(line.substr(at));
        if (digits == 0) {
            *to++ = line[at++];
            continue;
        }
        const char before = at > 0 ? line[at - 1] : ' ';
        const bool isFirst = isSeparator(before) || isSign(before) || before == '"';
        const bool mayGroup = isFirst && digits <= 3 && line[at] != '0';
        for (std::size_t d = 0; d < digits; ++d) *to++ = line[at++];
        while (const std::size_t mark = mayGroup ? groupAt(line.substr(at), groups) : 0) {
            at += mark;
            for (int d = 0; d < 3; ++d) *to++ = line[at++];
        }
        fit = fit && !(groups == Groups::Dots && isFirst && isRow && isPoint(line.substr(at)));
    }
    std::fill(to, end, ' ');
    return fit;
}

} // namespace mpuvdb
