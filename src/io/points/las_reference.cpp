#include "las_reference.h"

#include "column_names.h"
#include "files/text_scan.h"
#include "records.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <optional>
#include <string>

namespace mpuvdb
{
namespace
{

/// A file's reference system.
struct Reference {
    bool isGeographic = false;
    std::string name;
};

std::uint64_t integerAt(const std::string& bytes, ScalarType type, std::size_t at)
{
    return std::uint64_t(loadInteger(type, bytes.data() + at, false));
}

// ---- GeoTIFF

/// The record of the key directory, its keys, and the code of systems without an EPSG code.
/// [derived: GeoTIFF 1.1]
constexpr std::uint16_t kKeyDirectory = 34735;
constexpr std::uint64_t kModelKey = 1024, kGeographicKey = 2048, kProjectedKey = 3072;
enum Model : std::uint64_t { Undefined = 0, Projected = 1, Geographic = 2, Geocentric = 3 };
constexpr std::uint64_t kUserDefined = 32767; ///< [derived: GeoTIFF 1.1]

/// The system of a directory, whose header and keys are four 16-bit numbers each.
Reference referenceOfKeys(const std::string& directory)
{
    std::map<std::uint64_t, std::uint64_t> keys;
    for (std::size_t at = 8; at + 8 <= directory.size(); at += 8)
        if (integerAt(directory, ScalarType::UInt16, at + 2) == 0) // the value follows
            keys[integerAt(directory, ScalarType::UInt16, at)] =
                integerAt(directory, ScalarType::UInt16, at + 6);
    const std::uint64_t model = keys[kModelKey], code = keys[kGeographicKey];
    Reference reference;
    // A projected system also names its geographic one.
    reference.isGeographic = model == Geographic || (model != Projected && model != Geocentric &&
                                                     code != 0 && keys[kProjectedKey] == 0);
    if (code != 0 && code != kUserDefined) reference.name = fmt::format("EPSG:{} ", code);
    return reference;
}

// ---- well-known text

/// Walks over the keywords of well-known text: "GEOGCS" of GEOGCS["WGS 84",DATUM[...]].
class Keywords
{
public:
    explicit Keywords(std::string_view text) : mText(text) {}

    /// The next one in capitals; empty at the end.
    std::string next()
    {
        while (mAt < mText.size()) {
            if (mText[mAt] == '"') quoted();
            const std::string word = this->word();
            const std::size_t after = mText.find_first_not_of(" \t\r\n", mAt);
            const bool opens =
                after != std::string_view::npos && (mText[after] == '[' || mText[after] == '(');
            if (!word.empty() && opens) {
                mAt = after + 1;
                return word;
            }
            if (word.empty() && mAt < mText.size() && mText[mAt] != '"') ++mAt;
        }
        return {};
    }
    /// The next text in quotes.
    std::string quoted()
    {
        const std::string_view rest = mText.substr(mAt);
        const std::size_t begin = rest.find('"');
        const std::string_view inside =
            begin == std::string_view::npos ? std::string_view() : rest.substr(begin + 1);
        const std::size_t end = std::min(inside.find('"'), inside.size());
        mAt = inside.data() ? std::min(mAt + begin + end + 2, mText.size()) : mText.size();
        return std::string(inside.substr(0, end));
    }
    /// The word here, without quotes, in capitals.
    std::string word()
    {
        std::string word;
        for (; mAt < mText.size(); ++mAt) {
            const char c = mText[mAt];
            const bool isSmall = c >= 'a' && c <= 'z';
            if (!isSmall && !(c >= 'A' && c <= 'Z') && !isDigit(c) && c != '_') break;
            word += isSmall ? char(c - 'a' + 'A') : c;
        }
        return word;
    }

private:
    std::string_view mText;
    std::size_t mAt = 0;
};

/// The first system in the text: of compound systems the horizontal one comes first, of bound ones
/// the source, and base systems lie within others.
Reference referenceOfText(std::string_view text)
{
    Keywords keywords(text);
    for (std::string word = keywords.next(); !word.empty(); word = keywords.next()) {
        if (word == "GEOGCS" || word == "GEOGCRS" || word == "GEOGRAPHICCRS")
            return {true, inQuotes(keywords.quoted()) + " "};
        if (word == "GEODCRS" || word == "GEODETICCRS") { // geographic or geocentric
            const std::string name = inQuotes(keywords.quoted()) + " ";
            while (!word.empty() && word != "CS") word = keywords.next();
            return {keywords.word() == "ELLIPSOIDAL", name};
        }
        for (const char* lengths : {"PROJCS", "PROJCRS", "PROJECTEDCRS", "DERIVEDPROJCRS", "GEOCCS",
                                    "LOCAL_CS", "ENGCRS", "ENGINEERINGCRS", "FITTED_CS"})
            if (word == lengths) return {};
    }
    return {};
}

// ---- the file's records

constexpr std::uint16_t kWellKnownText = 2112; ///< record of the text [derived: LAS 1.4 R15]

struct Records {
    std::string keys, text; ///< empty: there is none
};

/// Reads one variable length record. @return its size, bytes.
std::uint64_t takeRecord(const ByteSource& source, std::uint64_t at, bool extended,
                         Records& records)
{
    // The longest description that is read, bytes. [tuned: las_reference_test]
    constexpr std::uint64_t kMaxBytes = 1 << 20;
    std::string head(extended ? 60 : 54, '\0');
    if (source.readSome(at, head.data(), head.size()) != head.size()) return source.size();
    const std::string user = head.substr(2, 16).c_str();
    const std::uint64_t id = integerAt(head, ScalarType::UInt16, 18);
    const std::uint64_t bytes =
        integerAt(head, extended ? ScalarType::UInt64 : ScalarType::UInt16, 20);
    std::string* const to = user != "LASF_Projection" && user != "liblas" ? nullptr
                            : id == kKeyDirectory                         ? &records.keys
                            : id == kWellKnownText                        ? &records.text
                                                                          : nullptr;
    if (to && to->empty()) {
        to->resize(std::size_t(std::min({bytes, kMaxBytes, source.size()})));
        to->resize(source.readSome(at + head.size(), to->data(), to->size()));
    }
    return head.size() + std::min(bytes, source.size());
}

/// The records before the points, and in version 1.4 those behind them.
Records readRecords(const ByteSource& source)
{
    const std::string head = source.head(kLasHeaderBytes14);
    Records records;
    std::uint64_t at = integerAt(head, ScalarType::UInt16, 94);
    for (auto left = integerAt(head, ScalarType::UInt32, 100); left > 0 && at < source.size();
         --left)
        at += takeRecord(source, at, false, records);
    if (head[25] < 4 || head.size() < kLasHeaderBytes14) return records;
    at = integerAt(head, ScalarType::UInt64, 235);
    for (auto left = integerAt(head, ScalarType::UInt32, 243); left > 0 && at < source.size();
         --left)
        at += takeRecord(source, at, true, records);
    return records;
}

} // namespace

void refuseDegrees(const ByteSource& source)
{
    const Records records = readRecords(source);
    const bool prefersText = (source.head(7)[6] & 0x10) != 0; // the header's global encoding
    const bool usesText = !records.text.empty() && (prefersText || records.keys.empty());
    const Reference reference =
        usesText ? referenceOfText(records.text) : referenceOfKeys(records.keys);
    if (reference.isGeographic)
        throw InputError(
            fmt::format("{}: its reference system {}is geographic: x and y are degrees, "
                        "beside heights in meters. {}.",
                        source.name(), reference.name, kReproject));
}

} // namespace mpuvdb
