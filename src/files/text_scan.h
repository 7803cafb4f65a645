// Numbers and words of a line of text.
#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace mpuvdb
{

/// What separates the values of a line.
inline bool isSeparator(char c)
{
    return c == ' ' || c == '\t' || c == ',' || c == ';' || c == '\r' || c == '\v' || c == '\f';
}

inline bool isDigit(char c)
{
    return c >= '0' && c <= '9';
}

/// Walks over one line's values.
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
    /// The next value as a number, correctly rounded; NaN and infinities as text count as numbers,
    /// what is too large for a double becomes infinite. @return false if it is none (or missing).
    bool number(double& value);
    /// The next value as an integer. @return false if it is none, or out of range.
    bool integer(std::int64_t& value);
    /// The next value as it stands; empty at the end.
    std::string_view word();

private:
    const char* mAt;
    const char* mEnd;
};

/// Walks over the fields of a line that one character separates; those in double quotes may hold
/// it, and lose the quotes.
class FieldScanner
{
public:
    FieldScanner(std::string_view line, char separator) : mRest(line), mSeparator(separator) {}
    /// @return false behind the last field.
    bool next(std::string_view& field);

private:
    std::string_view mRest;
    char mSeparator;
    bool mAtEnd = false;
};

/// @a text with ASCII capitals made small.
std::string lowerCase(std::string_view text);

/// At most 40 characters of @a text, fit for an error message.
std::string inQuotes(std::string_view text);

/// The first twenty of @a names, and how many more there are.
std::string listInQuotes(const std::vector<std::string>& names);

/// @a name with all but letters, digits and _ made _, and no digit first.
std::string identifier(const std::string& name);

} // namespace mpuvdb
