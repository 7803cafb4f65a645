#include "column_names.h"

#include "files/text_scan.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>

#include <algorithm>
#include <unordered_map>
#include <unordered_set>

namespace mpuvdb
{

const char* const kReproject =
    "Reproject the points to a system in meters first, such as the UTM zone of the place: pdal "
    "translate in.las out.las reprojection --filters.reprojection.out_srs=EPSG:32633";

namespace
{

using Words = std::unordered_set<std::string>;

bool isLetter(char c)
{
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c & 0x80) != 0;
}

std::string_view trimmed(std::string_view text)
{
    constexpr std::string_view kAround = " \t\r\"'";
    const std::size_t first = std::min(text.find_first_not_of(kAround), text.size());
    text.remove_prefix(first);
    return text.substr(0, text.find_last_not_of(kAround) + 1);
}

/// @a name with the letters of Western Europe as those without marks, "Höhe" as "Hohe": in UTF-8,
/// or in Latin-1 where it is not UTF-8, which programs for tables write.
std::string withoutAccents(std::string_view name)
{
    // Of the characters 0xc0 to 0xff. [derived: Unicode]
    constexpr std::string_view kLetters =
        "AAAAAAACEEEEIIIIDNOOOOO*OUUUUYTsaaaaaaaceeeeiiiidnooooo/ouuuuyty";
    std::string plain;
    while (!name.empty()) {
        char32_t code = 0;
        const std::size_t bytes = characterOf(name, code);
        if (bytes == 0) code = static_cast<unsigned char>(name.front());
        const std::string_view same = name.substr(0, std::max<std::size_t>(bytes, 1));
        name.remove_prefix(same.size());
        if (code >= 0x300 && code < 0x370) continue; // a mark on the letter before
        if (code >= 0xc0 && code <= 0xff)
            plain += kLetters[code - 0xc0];
        else
            plain += same;
    }
    return plain;
}

/// The words of a name in lower case and without accents: "gpsTime" and "GPS_time" have two.
std::vector<std::string> wordsOf(std::string_view written)
{
    const std::string name = withoutAccents(written);
    std::vector<std::string> words;
    bool goesOn = false;
    for (std::size_t at = 0; at < name.size(); ++at) {
        const bool isCapital = name[at] >= 'A' && name[at] <= 'Z';
        const bool afterSmall = at > 0 && name[at - 1] >= 'a' && name[at - 1] <= 'z';
        if (isLetter(name[at])) {
            if (!goesOn || (isCapital && afterSmall)) words.emplace_back();
            words.back() += lowerCase(std::string_view(name).substr(at, 1));
        }
        goesOn = isLetter(name[at]);
    }
    return words;
}

std::vector<std::string> splitAt(std::string_view line, char separator)
{
    std::vector<std::string> names;
    if (separator == ' ') {
        LineScanner scan(line);
        while (!scan.atEnd()) names.emplace_back(trimmed(scan.word()));
        return names;
    }
    for (;;) {
        const std::size_t end = line.find(separator);
        names.emplace_back(trimmed(line.substr(0, end)));
        if (end == std::string_view::npos) break;
        line.remove_prefix(end + 1);
    }
    while (!names.empty() && names.back().empty()) names.pop_back();
    return names;
}

/// @a line without the marks of a comment; a ';' that separates names is none.
std::string_view withoutMarks(std::string_view line)
{
    const std::size_t first = std::min(line.find_first_not_of(" \t\r\""), line.size());
    const bool isList = std::count(line.begin(), line.end(), ';') > 1;
    const std::string_view marks = isList ? "#/%!" : "#/%!;";
    if (first == line.size() || marks.find(line[first]) == std::string_view::npos) return line;
    line.remove_prefix(first);
    line.remove_prefix(std::min(line.find_first_not_of(marks), line.size()));
    return trimmed(line);
}

char separatorOf(std::string_view line)
{
    for (const char separator : {';', '\t', ','})
        if (line.find(separator) != std::string_view::npos) return separator;
    return ' ';
}

/// Whether @a name means what one of @a words does: else it has only units and words for positions.
bool means(const std::string& name, const Words& words)
{
    static const Words around = {"m",      "mm",          "cm",       "km",     "ft",    "feet",
                                 "meter",  "meters",      "metre",    "metres", "in",    "inch",
                                 "coord",  "coordinate",  "pos",      "point",  "local", "utm",
                                 "coords", "coordinates", "position", "points", "world", "global"};
    std::size_t found = 0;
    for (const std::string& word : wordsOf(name))
        if (words.count(word) > 0)
            ++found;
        else if (around.count(word) == 0)
            return false;
    return found == 1;
}

/// Makes columns whose names mean one of three attributes from @a first on that attribute, where
/// none has its usual name.
void findWords(const std::vector<std::string>& names, Attribute first, const Words (&words)[3],
               ColumnLayout& layout)
{
    for (std::size_t a = 0; a < 3; ++a) {
        const auto attribute = Attribute(std::size_t(first) + a);
        std::vector<Attribute>& columns = layout.columns;
        if (std::find(columns.begin(), columns.end(), attribute) != columns.end()) continue;
        for (std::size_t n = 0; n < names.size(); ++n)
            if (columns[n] == Attribute::None && means(names[n], words[a])) {
                columns[n] = attribute;
                break;
            }
    }
}

/// Finds axes by other names.
void findAxes(const std::vector<std::string>& names, ColumnLayout& layout)
{
    static const Words axes[3] = {
        {"x", "easting", "east", "e", "rechtswert", "ostwert", "ost", "est", "este"},
        {"y", "northing", "north", "n", "hochwert", "nordwert", "nord", "norte"},
        {"z", "elevation", "height", "altitude", "elev", "alt", "h", "hohe", "hoehe", "quota",
         "cota", "altitud", "altura", "altezza", "hauteur", "elevacion", "elevacao", "elevazione"}};
    findWords(names, Attribute::X, axes, layout);
}

/// Finds colors by other names, where all three are there: alone each may mean something else, such
/// as "rot" a rotation.
void findColors(const std::vector<std::string>& names, ColumnLayout& layout)
{
    static const Words colors[3] = {{"red", "rot", "rouge", "rojo", "rosso", "rood", "vermelho"},
                                    {"green", "grun", "gruen", "vert", "verde", "groen"},
                                    {"blue", "blau", "bleu", "azul", "blu", "blauw"}};
    ColumnLayout found = layout;
    findWords(names, Attribute::Red, colors, found);
    if (AttributeSet(found.columns).colors) layout = found;
}

/// A name that says a component of a vector, in the ways of ParaView ("Points:0", "Points_0") and
/// Houdini ("P[x]", "P.x").
struct Component {
    std::string vector; ///< in lower case, with the mark behind it; empty: it is none
    std::size_t index = 0;
};

Component componentOf(std::string_view name)
{
    if (!name.empty() && name.back() == ']') name.remove_suffix(1);
    if (name.size() < 3) return {};
    const char mark = name[name.size() - 2];
    if (std::string_view(":_.[").find(mark) == std::string_view::npos) return {};
    for (const std::string_view letters : {"012", "xyz", "rgb"}) {
        const std::size_t index = letters.find(lowerCase(name.substr(name.size() - 1)));
        if (index != std::string_view::npos)
            return {lowerCase(name.substr(0, name.size() - 1)), index};
    }
    return {};
}

/// Makes the three components of a vector, where all are there, what the vector's name says.
void findVectors(const std::vector<std::string>& names, ColumnLayout& layout)
{
    static const std::unordered_map<std::string, Attribute> vectors = {
        {"points", Attribute::X},
        {"point", Attribute::X},
        {"p", Attribute::X},
        {"position", Attribute::X},
        {"positions", Attribute::X},
        {"coordinates", Attribute::X},
        {"normals", Attribute::NormalX},
        {"normal", Attribute::NormalX},
        {"n", Attribute::NormalX},
        {"cd", Attribute::Red},
        {"rgb", Attribute::Red},
        {"colors", Attribute::Red},
        {"color", Attribute::Red}};
    std::vector<Component> parts;
    parts.reserve(names.size());
    for (const std::string& name : names) parts.push_back(componentOf(name));
    const auto find = [&](const std::string& vector, std::size_t index) {
        const auto at = std::find_if(parts.begin(), parts.end(), [&](const Component& part) {
            return part.vector == vector && part.index == index;
        });
        return std::size_t(at - parts.begin());
    };
    for (const Component& part : parts) {
        if (part.vector.empty() || part.index != 0) continue;
        const auto means = vectors.find(part.vector.substr(0, part.vector.size() - 1));
        if (means == vectors.end()) continue;
        const std::size_t at[3] = {find(part.vector, 0), find(part.vector, 1),
                                   find(part.vector, 2)};
        std::vector<Attribute>& columns = layout.columns;
        bool isFree = true;
        for (std::size_t c = 0; c < 3; ++c) {
            const auto a = Attribute(std::size_t(means->second) + c);
            isFree = isFree && at[c] < parts.size() && columns[at[c]] == Attribute::None &&
                     std::find(columns.begin(), columns.end(), a) == columns.end();
        }
        for (std::size_t c = 0; isFree && c < 3; ++c)
            columns[at[c]] = Attribute(std::size_t(means->second) + c);
    }
}

ColumnLayout layoutOf(const std::vector<std::string>& names, const ScalarNames& scalars)
{
    ColumnLayout layout;
    layout.names = names;
    for (const std::string& name : names) layout.columns.push_back(attributeOf(name, scalars));
    findVectors(names, layout);
    if (!AttributeSet(layout.columns).position) findAxes(names, layout);
    if (!AttributeSet(layout.columns).colors) findColors(names, layout);
    if (!AttributeSet(layout.columns).position) layout.columns.clear();
    return layout;
}

/// Whether this is a column's name rather than a word of a sentence: by a word known from formats
/// of points, or by its spelling.
bool looksLikeName(const std::string& name)
{
    static const Words known = {"id",
                                "index",
                                "idx",
                                "time",
                                "timestamp",
                                "gps",
                                "range",
                                "distance",
                                "azimuth",
                                "zenith",
                                "angle",
                                "elevation",
                                "height",
                                "altitude",
                                "intensity",
                                "amplitude",
                                "classification",
                                "class",
                                "return",
                                "returns",
                                "ring",
                                "channel",
                                "reflectance",
                                "reflectivity",
                                "longitude",
                                "latitude",
                                "lon",
                                "lat",
                                "lng",
                                "alt",
                                "elev",
                                "easting",
                                "northing",
                                "rechtswert",
                                "hochwert",
                                "hohe",
                                "quota",
                                "cota",
                                "shot",
                                "shotnumber",
                                "red",
                                "green",
                                "blue",
                                "label",
                                "confidence",
                                "quality",
                                "normal",
                                "theta",
                                "phi",
                                "rho",
                                "radius",
                                "curvature",
                                "number",
                                "deviation",
                                "east",
                                "north",
                                "beam",
                                "scalar",
                                "timestamps"};
    const std::vector<std::string> words = wordsOf(name);
    if (words.size() == 1 && words.front().size() == 1) return true;
    if (name.find_first_of("_[]()0123456789") != std::string::npos) return true;
    return std::any_of(words.begin(), words.end(),
                       [](const std::string& word) { return known.count(word) > 0; });
}

bool isOfSentences(const std::string& name)
{
    static const Words words = {"a",       "an",       "the",     "of",   "by",        "from",
                                "with",    "for",      "and",     "in",   "on",        "at",
                                "to",      "is",       "are",     "was",  "this",      "that",
                                "created", "exported", "made",    "file", "generated", "written",
                                "using",   "which",    "contains"};
    const std::vector<std::string> inside = wordsOf(name);
    const bool ends = name.find_last_of(".:!?") == name.size() - 1;
    // "a" alone may be a column, like "b".
    return ends || (inside.size() == 1 ? inside.front() != "a" && words.count(inside.front()) > 0
                                       : std::any_of(inside.begin(), inside.end(),
                                                     [](auto& w) { return words.count(w) > 0; }));
}

} // namespace

bool ColumnNames::areWords() const
{
    const auto isWord = [this](const std::string& name) {
        double value = 0;
        LineScanner scan(name);
        // An index has no name in some programs' headers.
        return name.empty() ? separator != ' '
                            : (isLetter(name[0]) || name[0] == '_') && !scan.number(value);
    };
    return names.size() > 1 && std::all_of(names.begin(), names.end(), isWord);
}

bool ColumnNames::areDegrees() const
{
    const auto isDegrees = [](const std::string& name) {
        bool axis = false, degrees = false;
        for (const std::string& word : wordsOf(name)) {
            axis |= word == "x" || word == "y";
            degrees |= word == "deg" || word == "degree" || word == "degrees";
            if (word == "lon" || word == "long" || word == "lng" || word == "lat") return true;
            if (word.find("longitud") != std::string::npos) return true;
            if (word.find("latitud") != std::string::npos) return true;
        }
        return axis && degrees;
    };
    return std::count_if(names.begin(), names.end(), isDegrees) >= 2;
}

ColumnNames columnNames(std::string_view line, std::uint64_t number)
{
    line = withoutMarks(line);
    ColumnNames names;
    names.separator = separatorOf(line);
    names.names = splitAt(line, names.separator);
    names.line = number;
    return names;
}

ColumnLayout layoutFromNames(std::string_view line, const ScalarNames& scalars)
{
    const ColumnNames names = columnNames(line, 0);
    ColumnLayout layout = layoutOf(names.names, scalars);
    // "x, y, z nx ny nz"
    if (layout.columns.empty() && names.separator != ' ' && !names.areDegrees())
        layout = layoutOf(splitAt(withoutMarks(line), ' '), scalars);
    return layout;
}

bool commentNamesColumns(const ColumnNames& comment, std::string_view row, std::size_t columns)
{
    const std::vector<std::string>& names = comment.names;
    if (names.size() != columns || !comment.areWords()) return false;
    if (std::any_of(names.begin(), names.end(), isOfSentences)) return false;
    if (comment.separator != ' ' && comment.separator == separatorOf(row)) return true;
    return 2 * std::size_t(std::count_if(names.begin(), names.end(), looksLikeName)) >= columns;
}

void throwNoPositions(const std::string& file, const ColumnNames& names)
{
    const std::string list = listInQuotes(names.names);
    if (names.areDegrees())
        throw InputError(fmt::format("{}: line {} names the columns {}: longitude and latitude are "
                                     "degrees, beside heights in meters. {}; and name the columns "
                                     "x, y and z.",
                                     file, names.line, list, kReproject));
    throw InputError(fmt::format("{}: line {} names the columns {}, but not x, y and z. Name those "
                                 "with the positions so, or take the line out if these are the "
                                 "first three.",
                                 file, names.line, list));
}

} // namespace mpuvdb
