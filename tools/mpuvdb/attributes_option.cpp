// --attributes, of the verbs that carry colors and scalars.
#include "verb.h"

#include <algorithm>
#include <iterator>
#include <sstream>

namespace mpuvdb::command
{
namespace
{

/// The names in "Cd,intensity".
std::vector<std::string> parseNames(const std::string& text)
{
    std::vector<std::string> names;
    std::istringstream stream(text);
    for (std::string name; std::getline(stream, name, ',');) {
        if (name.empty() || std::find(names.begin(), names.end(), name) != names.end())
            throw UsageError("--attributes " + text +
                             ": a name is empty or repeated. Give each name once");
        names.push_back(name);
    }
    return names;
}

} // namespace

bool Attributes::has(const std::string& name) const
{
    return std::find(names.begin(), names.end(), name) != names.end();
}

void Attributes::choose(bool colors)
{
    if (automatic && colors) names = {kColorName};
    if (has(kColorName) && !colors)
        throw UsageError("--attributes: the input has no colors for Cd. Leave Cd out");
}

std::vector<std::string> Attributes::scalars() const
{
    std::vector<std::string> result;
    std::copy_if(
        names.begin(), names.end(), std::back_inserter(result),
        [](const std::string& name) { return name != kColorName && name != "confidence"; });
    return result;
}

CLI::Option* addAttributes(CLI::App& app, Attributes& attributes, const std::string& what)
{
    return app
        .add_option_function<std::string>(
            "--attributes",
            [&attributes](const std::string& text) {
                attributes.automatic = text == "auto";
                if (!attributes.automatic && text != "none") attributes.names = parseNames(text);
            },
            what)
        ->type_name("auto|none|NAME,...");
}

} // namespace mpuvdb::command
