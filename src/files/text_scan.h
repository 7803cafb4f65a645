// Numbers and words of a line of text.
#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace mpuvdb
{

/// Whether @a c separates the values of a line.
inline bool isSeparator(char c)
{
    return c == ' ' || c == '\t' || c == ',' || c == ';' || c == '\r' || c == '\v' || c == '\f';
}

inline bool isDigit(char c)
{
    return c >= '0' && c <= '9';
}

/// Reader of one line's values.
class LineScanner
{
public:
    explicit LineScanner(std::string_view line) : mAt(line.data()), mEnd(line.data() + line.size())
    {
    }
    /// Whether nothing but separators is left.
    bool atEnd()
    {
        while (mAt != mEnd && isSeparator(*mAt)) ++mAt;
        return mAt == mEnd;
    }
    /// Whether nothing but separators or a comment ("#", "//") is left.
    bool atEndOrComment()
    {
        return atEnd() || *mAt == '#' || (*mAt == '/' && mAt + 1 != mEnd && mAt[1] == '/');
    }
    /// Read a number, correctly rounded; NaN and infinities as text count as numbers, values too
    /// large for a double become infinite, and an exponent may begin with Fortran's D. @return
    /// false if it is none (or missing).
    bool number(double& value);
    /// Read an integer. @return false if it is none, or out of range.
    bool integer(std::int64_t& value);
    /// The next value as it stands; empty at the end.
    std::string_view word();

private:
    const char* mAt;
    const char* mEnd;
};

/// Reader of the fields of a line that one character separates; fields in double quotes may hold
/// it, and lose the quotes.
class FieldScanner
{
public:
    FieldScanner(std::string_view line, char separator) : mRest(line), mSeparator(separator) {}
    /// Read a field. @return false behind the last one.
    bool next(std::string_view& field);

private:
    std::string_view mRest;
    char mSeparator;
    bool mAtEnd = false;
};

/// @a text in lower case (ASCII).
std::string lowerCase(std::string_view text);

/// The first character of @a text, UTF-8. @return its bytes; 0 if there is none, or no valid one.
std::size_t characterOf(std::string_view text, char32_t& code);

/// At most 40 characters of @a text, fit for an error message: control characters and bytes that
/// are not UTF-8 are question marks.
std::string inQuotes(std::string_view text);

/// The first twenty of @a names, and how many more there are.
std::string listInQuotes(const std::vector<std::string>& names);

/// @a name as an identifier: all but letters, digits and _ become _, and no digit is first.
std::string identifier(const std::string& name);

} // namespace mpuvdb
