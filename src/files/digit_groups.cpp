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
           text.find_first_not_of("0123456789+-.eEdD") == std::string_view::npos &&
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

/// Whether @a text is like 123,5: below 1000, with decimals.
bool isSmallDecimal(std::string_view text, char point)
{
    NumberParts parts(text);
    const std::string_view digits = parts.digits();
    return digits.size() <= 3 && parts.mark(point) && !parts.digits().empty() && parts.ends();
}

/// Calls f(word) for what blanks, tabs and semicolons separate, without quotes.
template <class F>
void forEachWord(std::string_view line, const F& f)
{
    const auto isGap = [](char c) { return c != ',' && isSeparator(c); };
    for (std::size_t at = 0; at < line.size();) {
        std::size_t end = at;
        while (end < line.size() && !isGap(line[end])) ++end;
        std::string_view word = line.substr(at, end - at);
        while (!word.empty() && (word.front() == '"' || word.front() == ',')) word.remove_prefix(1);
        while (!word.empty() && (word.back() == '"' || word.back() == ',')) word.remove_suffix(1);
        if (!word.empty()) f(word);
        at = end + 1;
    }
}

/// Bytes of a separator at the beginning of @a text; 0: there is none.
std::size_t markAt(std::string_view text, Groups groups)
{
    if (text.empty()) return 0;
    if (groups == Groups::Dots && text.front() == '.') return 1;
    if (groups == Groups::Commas && text.front() == ',') return 1;
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
    if (mCommas) addCommas(line);
    if (mBlanks) addBlanks(line);
    addSpaced(line);
}

void GroupEvidence::noteExample(std::string_view line)
{
    if (mExample.empty()) mExample = line;
}

// A row like 1.234,5 2.345,6 3.456,7 is no list: nobody parts numbers by commas and by blanks.
void GroupEvidence::addDots(std::string_view line)
{
    std::vector<std::string_view> numbers;
    bool fits = true, isSure = false;
    const auto add = [&](std::string_view word) {
        const bool grouped = isGrouped(word, '.', ',');
        const auto dots = std::count(word.begin(), word.end(), '.');
        isSure |= grouped && (dots > 1 || (dots > 0 && word.find(',') != std::string_view::npos));
        const bool asDecimal = grouped || isSmallDecimal(word, ',');
        if (!asDecimal && (!isNumber(word) || dots > 1)) word = {}; // a word, or a date
        numbers.push_back(word);
        fits = fits && (word.empty() || asDecimal || isSmall(word));
    };
    forEachWord(line, [&](std::string_view word) {
        while (!isGrouped(word, '.', ',') && !isSmallDecimal(word, ',')) {
            const std::size_t comma = word.find(',');
            if (comma == std::string_view::npos) break;
            add(word.substr(0, comma));
            word.remove_prefix(comma + 1);
        }
        add(word);
    });
    if (std::count_if(numbers.begin(), numbers.end(), [](auto n) { return !n.empty(); }) < 3)
        return;
    if (!fits) {
        mBroken = mDotted >= kSureDots && columnMixes();
        mDots = false;
        return;
    }
    mSureDots |= isSure;
    if (mColumns.size() < numbers.size()) mColumns.resize(numbers.size());
    for (std::size_t c = 0; c < numbers.size(); ++c) {
        const bool dotted = numbers[c].find('.') != std::string_view::npos;
        mDotted += dotted;
        mColumns[c].dotted |= dotted;
        mColumns[c].small |= !dotted && !numbers[c].empty() && numbers[c] != "0";
        if (dotted) noteExample(line);
    }
}

// A row like 1,234.5 2,345.6 3,456.7 is no list for the same reason.
void GroupEvidence::addCommas(std::string_view line)
{
    std::size_t numbers = 0;
    bool fits = true, isSure = false, any = false;
    forEachWord(line, [&](std::string_view word) {
        if (!beginsNumber(word)) return;
        ++numbers;
        const bool grouped = isGrouped(word, ',', '.');
        fits = fits && (grouped || isSmallDecimal(word, '.') || isSmall(word));
        any |= grouped;
        isSure |= grouped && word.find('.') != std::string_view::npos;
    });
    if (numbers < 3) return;
    mCommas = fits;
    mSureCommas |= isSure;
    if (fits && any) noteExample(line);
}

// In rows like 5 341,06 6 058,15 7 935,00 blanks both group and separate.
void GroupEvidence::addSpaced(std::string_view line)
{
    if (line.find_first_of(";\t") != std::string_view::npos) return;
    std::vector<std::string_view> words;
    forEachWord(line, [&](std::string_view word) { words.push_back(word); });
    if (words.size() < 4 || !std::all_of(words.begin(), words.end(), beginsNumber)) return;
    if (mSpaced.empty()) mSpaced.resize(words.size());
    for (std::size_t c = 0; c < std::min(words.size(), mSpaced.size()); ++c) {
        mSpaced[c].small = mSpaced[c].small && isSmall(words[c]);
        mSpaced[c].three = mSpaced[c].three && digitsAt(words[c]) == 3;
        mSpaced[c].broken = mSpaced[c].broken && words[c].find_first_of(".,") != words[c].npos;
        mSpaced[c].padded |= words[c].front() == '0' && digitsAt(words[c]) == 3;
    }
    if (blanksDoBoth()) noteExample(line);
}

// Whether there are numbers like 034 that nothing but a small whole number before them explains, or
// all the columns are pairs of a small whole number and one with three digits and decimals.
bool GroupEvidence::blanksDoBoth() const
{
    bool any = mSpaced.size() >= 6 && mSpaced.size() % 2 == 0;
    for (std::size_t c = 1; c < mSpaced.size(); c += 2)
        any = any && mSpaced[c - 1].small && mSpaced[c].three && mSpaced[c].broken;
    for (std::size_t c = 0; c < mSpaced.size(); ++c) {
        if (!mSpaced[c].padded) continue;
        if (c == 0 || !mSpaced[c].three || !mSpaced[c - 1].small) return false;
        any = true;
    }
    return any;
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
        const std::size_t index = fields++;
        const auto blanks = std::size_t(std::count(field.begin(), field.end(), ' '));
        numbers += 1 + blanks;
        if (blanks == 0) continue;
        blanked = true;
        zero |= field.find(" 0") != std::string_view::npos;
        if (field.find_first_of(".,") != std::string_view::npos) {
            mTwoBroken |= mBrokenField < index;
            mBrokenField = std::min(mBrokenField, index);
        }
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
    if (mBroken || blanksDoBoth()) return std::nullopt;
    if (mBlanks && mBlanked) {
        if (mZeroGroup || mTwoBroken || mLeast < mMost) return Groups::Blanks;
        return std::nullopt;
    }
    if (mDots && (mSureDots || (mDotted >= kSureDots && columnMixes()))) return Groups::Dots;
    if (mCommas && mSureCommas) return Groups::Commas;
    if (mDots && mDotted >= kLikelyDots && columnMixes()) return std::nullopt;
    return mDots || mCommas || mBlanks ? Groups::Unknown : Groups::None;
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
