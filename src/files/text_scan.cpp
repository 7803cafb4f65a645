#include "text_scan.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <limits>

namespace mpuvdb
{
namespace
{

/// Powers of ten that a double holds exactly. [derived: 5^22 < 2^53]
constexpr std::array<double, 23> kPowersOfTen = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,
                                                 1e8,  1e9,  1e10, 1e11, 1e12, 1e13, 1e14, 1e15,
                                                 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};

// Digits up to 2^53 times or over a power of ten up to 10^22 are two exact doubles, so that one
// operation rounds correctly [Clinger90]. @return the end, or null where that does not apply.
const char* scanShortDecimal(const char* at, const char* end, double& value)
{
    const bool negative = at != end && *at == '-';
    if (negative) ++at;
    std::uint64_t digits = 0;
    const char* first = at;
    while (at != end && isDigit(*at)) digits = digits * 10 + std::uint64_t(*at++ - '0');
    std::ptrdiff_t count = at - first;
    int exponent = 0;
    if (at != end && *at == '.') {
        const char* point = ++at;
        while (at != end && isDigit(*at)) digits = digits * 10 + std::uint64_t(*at++ - '0');
        exponent = -int(std::min<std::ptrdiff_t>(at - point, 1000));
        count += at - point;
    }
    if (count == 0 || count > 19) return nullptr;
    if (at != end && (*at == 'e' || *at == 'E')) {
        if (++at != end && *at == '+') ++at;
        int written = 0;
        const auto [after, error] = std::from_chars(at, end, written);
        if (error != std::errc() || written > 1000 || written < -1000) return nullptr;
        exponent += written;
        at = after;
    }
    if (digits > (std::uint64_t(1) << 53) || exponent < -22 || exponent > 22) return nullptr;
    const double scale = kPowersOfTen[std::size_t(exponent < 0 ? -exponent : exponent)];
    const double magnitude = exponent < 0 ? double(digits) / scale : double(digits) * scale;
    value = negative ? -magnitude : magnitude;
    return at;
}

// Visual C++ wrote "1.#QNAN", "-1.#IND" and "1.#INF".
bool isOldStyleNotFinite(std::string_view word)
{
    return word.find("1.#") != std::string_view::npos;
}

// Infinity for overflow, zero for underflow: from_chars does not say which it was.
double beyondDoubles(std::string_view word)
{
    const std::size_t e = word.find_first_of("eE");
    const bool tiny = e == std::string_view::npos ? word.find("0.") != std::string_view::npos
                                                  : word.find('-', e) != std::string_view::npos;
    return tiny ? 0.0 : std::numeric_limits<double>::infinity();
}

// Fortran's mark of the exponent of a number in double precision, which is an E to all others.
std::string withoutD(std::string_view word)
{
    std::string plain(word);
    const std::size_t d = plain.find_first_of("dD");
    if (d != std::string::npos && d > 0 && (isDigit(plain[d - 1]) || plain[d - 1] == '.'))
        plain[d] = 'e';
    return plain;
}

bool parseAnyNumber(std::string_view word, double& value)
{
    if (!word.empty() && word.front() == '+') word.remove_prefix(1);
    const auto [at, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (error == std::errc::result_out_of_range) value = beyondDoubles(word);
    if (error != std::errc::invalid_argument && at == word.data() + word.size()) return true;
    if (const std::string plain = withoutD(word); plain != word)
        return parseAnyNumber(plain, value);
    if (!isOldStyleNotFinite(word)) return false;
    value = std::numeric_limits<double>::quiet_NaN();
    return true;
}

/// Whether a terminal shows @a code where it stands: it is no control character, and none that
/// breaks lines or turns the direction of writing.
bool isPrintable(char32_t code)
{
    const bool isControl = code < 0x20 || (code >= 0x7f && code < 0xa0);
    const bool movesText = (code >= 0x2028 && code <= 0x202e) || (code >= 0x2066 && code <= 0x2069);
    return !isControl && !movesText;
}

} // namespace

bool FieldScanner::next(std::string_view& field)
{
    if (mAtEnd) return false;
    const auto isBlank = [this](char c) { return c != mSeparator && isSeparator(c); };
    while (!mRest.empty() && isBlank(mRest.front())) mRest.remove_prefix(1);
    std::size_t end = 0;
    if (!mRest.empty() && mRest.front() == '"') {
        end = std::min(mRest.find('"', 1), mRest.size());
        field = mRest.substr(1, end - 1);
        mRest.remove_prefix(std::min(end + 1, mRest.size()));
        end = std::min(mRest.find(mSeparator), mRest.size());
    } else {
        end = std::min(mRest.find(mSeparator), mRest.size());
        field = mRest.substr(0, end);
    }
    mAtEnd = end == mRest.size();
    mRest.remove_prefix(mAtEnd ? end : end + 1);
    return true;
}

bool LineScanner::number(double& value)
{
    if (atEnd()) return false;
    const char* after = scanShortDecimal(mAt, mEnd, value);
    if (after && (after == mEnd || isSeparator(*after))) {
        mAt = after;
        return true;
    }
    return parseAnyNumber(word(), value);
}

bool LineScanner::integer(std::int64_t& value)
{
    if (atEnd()) return false;
    const char* start = *mAt == '+' ? mAt + 1 : mAt;
    const auto [after, error] = std::from_chars(start, mEnd, value);
    if (error != std::errc() || (after != mEnd && !isSeparator(*after))) return false;
    mAt = after;
    return true;
}

std::string_view LineScanner::word()
{
    if (atEnd()) return {};
    const char* start = mAt;
    while (mAt != mEnd && !isSeparator(*mAt)) ++mAt;
    return {start, std::size_t(mAt - start)};
}

std::string lowerCase(std::string_view text)
{
    std::string lower(text);
    for (char& c : lower)
        if (c >= 'A' && c <= 'Z') c = char(c - 'A' + 'a');
    return lower;
}

std::size_t characterOf(std::string_view text, char32_t& code)
{
    if (text.empty()) return 0;
    const auto first = static_cast<unsigned char>(text.front());
    const std::size_t bytes = first < 0x80             ? 1
                              : (first & 0xe0) == 0xc0 ? 2
                              : (first & 0xf0) == 0xe0 ? 3
                              : (first & 0xf8) == 0xf0 ? 4
                                                       : 0;
    if (bytes == 0 || bytes > text.size()) return 0;
    code = bytes == 1 ? first : first & (0xffu >> (bytes + 1));
    for (const char next : text.substr(1, bytes - 1)) {
        if ((next & 0xc0) != 0x80) return 0;
        code = (code << 6) | char32_t(next & 0x3f);
    }
    // The least number that needs so many bytes; the surrogates of UTF-16 are no characters.
    constexpr char32_t kLeast[] = {0, 0x80, 0x800, 0x10000}; // [derived: UTF-8]
    const bool isOne = code >= kLeast[bytes - 1] && code <= 0x10ffff && (code & ~0x7ffu) != 0xd800;
    return isOne ? bytes : 0;
}

std::string inQuotes(std::string_view text)
{
    constexpr std::size_t kMaxCharacters = 40; ///< shown [free: a message's length]
    std::string shown;
    for (std::size_t count = 0; !text.empty(); ++count) {
        if (count == kMaxCharacters) return "'" + shown + "...'";
        char32_t code = 0;
        const std::size_t bytes = characterOf(text, code);
        if (bytes > 0 && isPrintable(code))
            shown += text.substr(0, bytes);
        else
            shown += '?';
        text.remove_prefix(std::max<std::size_t>(bytes, 1));
    }
    return "'" + shown + "'";
}

std::string listInQuotes(const std::vector<std::string>& names)
{
    constexpr std::size_t kMaxNames = 20; ///< names listed [free: a message's length]
    std::string list;
    for (std::size_t n = 0; n < std::min(names.size(), kMaxNames); ++n)
        list += (n > 0 ? ", " : "") + inQuotes(names[n]);
    if (names.size() > kMaxNames)
        list += " and " + std::to_string(names.size() - kMaxNames) + " more";
    return list;
}

std::string identifier(const std::string& name)
{
    std::string result;
    for (const char c : name) {
        const bool letter = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
        result += letter || (c >= '0' && c <= '9') ? c : '_';
    }
    if (result.empty() || (result.front() >= '0' && result.front() <= '9')) result.insert(0, "_");
    return result;
}

} // namespace mpuvdb
