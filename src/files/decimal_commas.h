// The meaning of commas in a text of numbers: decimal points, or separators.
#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

namespace mpuvdb
{

/// Meaning of the commas of a whole input.
enum class Commas : std::uint8_t {
    Unknown,  ///< not decided so far
    Separate, ///< they stand between values
    Decimal   ///< they stand for decimal points
};

/// Evidence from rows of numbers about the meaning of their commas. A comma between two characters
/// of numbers may belong to one number or separate two; beside a blank, semicolon, quote or comma
/// it separates.
class CommaEvidence
{
public:
    /// Add a line. Lines without at least three numbers, after words, are no evidence.
    void add(std::string_view line);
    /// Rows of numbers with commas so far.
    std::size_t rows() const { return mRows; }
    /// The meaning under which the rows are those of a table, which has one separator. None where
    /// two meanings fit, or commas separate thousands.
    std::optional<Commas> decide() const;

private:
    struct Field {
        std::string_view text;
        bool quoted = false;  ///< within quotes
        bool byComma = false; ///< a comma stands between it and what is before
    };
    struct Row {
        std::vector<Field> numbers;
        bool words = false;   ///< words stand before the numbers
        bool leading = false; ///< a comma has a blank before and a digit after it
    };
    /// Range of the count of numbers per row.
    struct Counts {
        std::size_t least = SIZE_MAX, most = 0;
        void add(std::size_t count);
        /// Points have at least three coordinates.
        bool areTable() const { return least == most && least >= 3; }
    };

    static Row split(std::string_view line);
    void addNumber(const Field& field);
    /// Look for numbers with decimal commas in a list of whole numbers and commas. @return whether
    /// it can be nothing else: nobody writes whole numbers as "-0" or "05".
    bool addPairs(std::string_view list);

    std::size_t mRows = 0;
    bool mInner = false;       ///< a comma stands within a number or list
    bool mBare = false;        ///< numbers are separated without a comma in a row that has one
    bool mByComma = false;     ///< numbers are separated by a comma beside a blank or quote
    bool mQuoted = true;       ///< every comma within a number is within quotes
    bool mLeading = false;     ///< a number may begin with a comma
    bool mDecimal = true;      ///< all numbers with a comma are like 1,5, and none has a point
    bool mThousands = true;    ///< all such numbers are like 1,234 or 1,234.5
    bool mEuropean = true;     ///< all are like 1.234,5 or 1,5; those without a comma like 1.234
    bool mSmallWhole = false;  ///< a whole number other than 0 has no comma
    bool mList = false;        ///< there is a list of numbers, like 1.5,2.5 or 1,2,3
    bool mPairs = true;        ///< lists may be pairs around decimal commas
    bool mMustBePairs = false; ///< some lists have to be
    Counts mIfDecimal, mIfSeparate;
};

/// Turn the decimal commas of a line into points, and quotes around its numbers into blanks.
void commasToPoints(char* begin, char* end);

} // namespace mpuvdb
