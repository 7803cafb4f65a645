// Separators between the digits of large numbers in a text: 1.234.567, 1 234 567, 1'234'567.
#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace mpuvdb
{

/// What groups the digits of a whole table, besides apostrophes and blanks that do not break a
/// line, which can do nothing else.
enum class Groups : std::uint8_t {
    Unknown, ///< not decided so far
    None,    ///< dots are decimal points, and blanks separate numbers
    Dots,
    Commas,
    Blanks ///< within columns that something else separates
};

/// Evidence from rows of a table about what groups their digits.
class GroupEvidence
{
public:
    /// Add a line. Lines with fewer than three numbers are no evidence.
    void add(std::string_view line);
    /// Whether a number was there that is read in another way with groups.
    bool any() const { return !mExample.empty(); }
    /// The first row with such a number.
    const std::string& example() const { return mExample; }
    /// The meaning that fits all rows. None where two of them do.
    std::optional<Groups> decide() const;

private:
    void addDots(std::string_view line);
    void addCommas(std::string_view line);
    void addBlanks(std::string_view line);
    void addSpaced(std::string_view line);
    void noteExample(std::string_view line);
    bool columnMixes() const;
    bool blanksDoBoth() const;

    struct Column {
        bool dotted = false; ///< like 1.234
        bool small = false;  ///< whole, and not 0
    };
    /// A column of rows in which nothing but blanks separates numbers.
    struct Spaced {
        bool small = true;   ///< all are whole and below 1000
        bool three = true;   ///< all have three digits before their decimals
        bool broken = true;  ///< and decimals
        bool padded = false; ///< one of them begins with a zero
    };
    std::vector<Column> mColumns;
    std::vector<Spaced> mSpaced;
    std::string mExample;
    bool mDots = true;      ///< dots may group: all numbers are like 1.234, 1.234,5, 123 or 123,5
    bool mSureDots = false; ///< a number is like 1.234.567 or 1.234,5, which nothing else explains
    bool mCommas = true;    ///< commas may group: all are like 1,234, 1,234.5, 123 or 123.5
    bool mSureCommas = false; ///< a number is like 1,234.5
    bool mBroken = false;     ///< a decimal point came after rows that dots seemed to group
    std::size_t mDotted = 0;  ///< numbers like 1.234
    bool mBlanks = true;      ///< blanks may group: what they part is like 1 234
    bool mBlanked = false;    ///< there are numbers like 1 234
    bool mZeroGroup = false;  ///< one is like 1 034: nobody writes a whole number as 034
    std::size_t mBrokenField = SIZE_MAX;      ///< a column with numbers like 1 234.5
    bool mTwoBroken = false;                  ///< there is another one
    std::size_t mLeast = SIZE_MAX, mMost = 0; ///< numbers of a row, if blanks separate them
};

/// Whether @a text has a separator that can only group digits.
bool hasGroupMarks(std::string_view text);

/// Take the separators of groups out of the numbers of a line, which keeps its length: apostrophes,
/// blanks that do not break a line, and what @a groups says. @return whether all numbers fit it.
bool dropGroups(char* begin, char* end, Groups groups);

} // namespace mpuvdb
