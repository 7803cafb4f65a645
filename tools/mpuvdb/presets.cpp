#include "presets.h"

#include "verb.h"

#include <fmt/format.h>

#include <algorithm>
#include <vector>

namespace mpuvdb::command
{
namespace
{

struct Setting {
    const char *option, *value;
};

struct Preset {
    const char *name, *what;
    std::vector<Setting> settings;
};

const std::vector<Preset>& presets()
{
    static const std::vector<Preset> all = {
        {"scan",
         "scanners' points: outliers, wrong normals, noise",
         {{"--outliers", "drop"}, {"--normals", "auto"}, {"--holes", "close"}}},
        {"clean",
         "exact points of CAD or simulations: none is dropped or turned",
         {{"--outliers", "keep"}, {"--normals", "keep"}, {"--tolerance", "0.1vx"}}},
        {"particles",
         "a surface through particles: smooth, single particles stay",
         {{"--outliers", "keep"}, {"--no-sharp", "true"}, {"--alpha", "1"}}},
        // A viewpoint so high that the view is straight down, whatever the survey's coordinates.
        {"terrain",
         "surveys seen from above (+Z): open underneath",
         {{"--viewpoint", "0,0,1e12"},
          {"--normals", "estimate"},
          {"--holes", "open"},
          {"--coverage", "true"}}}};
    return all;
}

std::string typed(const Setting& s)
{
    return std::string(s.value) == "true" ? s.option : fmt::format("{} {}", s.option, s.value);
}

std::string typed(const std::vector<Setting>& settings)
{
    std::string text;
    for (const Setting& s : settings) text += (text.empty() ? "" : " ") + typed(s);
    return text;
}

} // namespace

CLI::Option* addPreset(CLI::App& app, std::string& preset)
{
    std::string help = "Options for a kind of data, as far as this verb has them; options given "
                       "beside it\ntake precedence";
    std::vector<std::string> names;
    for (const Preset& p : presets()) {
        names.push_back(p.name);
        help += fmt::format("\n{}: {}\n  {}", p.name, p.what, typed(p.settings));
    }
    return app.add_option("--preset", preset, help)
        ->type_name("scan|clean|particles|terrain")
        ->check(oneOf(names));
}

std::string applyPreset(CLI::App& app, const std::string& preset)
{
    const auto found = std::find_if(presets().begin(), presets().end(),
                                    [&](const Preset& p) { return p.name == preset; });
    if (found == presets().end()) return {};
    std::vector<Setting> set;
    for (const Setting& s : found->settings) {
        CLI::Option* const option = app.get_option_no_throw(s.option);
        if (!option || option->count() > 0) continue;
        option->add_result(std::string(s.value));
        option->run_callback();
        set.push_back(s);
    }
    return typed(set);
}

} // namespace mpuvdb::command
