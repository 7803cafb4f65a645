// The parts of a number as programs of some countries write it.
#pragma once
#include <algorithm>
#include <string_view>

namespace mpuvdb
{

inline bool isSign(char c)
{
    return c == '+' || c == '-';
}

/// Parser of the parts of a number.
class NumberParts
{
public:
    explicit NumberParts(std::string_view text) : mText(text)
    {
        if (!mText.empty() && isSign(mText.front())) mText.remove_prefix(1);
    }
    std::string_view digits()
    {
        const std::size_t count = std::min(mText.find_first_not_of("0123456789"), mText.size());
        const std::string_view taken = mText.substr(0, count);
        mText.remove_prefix(count);
        return taken;
    }
    bool mark(char c)
    {
        const bool is = !mText.empty() && mText.front() == c;
        if (is) mText.remove_prefix(1);
        return is;
    }
    /// One to three digits, then groups of three after @a separator. @return whether there are any.
    bool groups(char separator)
    {
        const std::string_view first = digits();
        if (first.empty() || first.size() > 3 || first.front() == '0') return false;
        bool any = false;
        while (mark(separator)) {
            if (digits().size() != 3) return false;
            any = true;
        }
        return any;
    }
    bool isEmpty() const { return mText.empty(); }
    /// Whether nothing but an exponent is left.
    bool ends()
    {
        if (mark('e') || mark('E') || mark('d') || mark('D')) {
            if (!mark('-')) mark('+');
            if (digits().empty()) return false;
        }
        return mText.empty();
    }

private:
    std::string_view mText;
};

/// Whether @a text is like 1,234 or 1,234.5 with ',' and '.'; like 1.234 or 1.234,5 with '.' and
/// ','.
inline bool isGrouped(std::string_view text, char separator, char point)
{
    NumberParts parts(text);
    if (!parts.groups(separator)) return false;
    if (parts.mark(point)) parts.digits();
    return parts.ends();
}

} // namespace mpuvdb
