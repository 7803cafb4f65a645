// "did you mean": the known word nearest to a mistyped one.
#pragma once
#include <optional>
#include <string>
#include <vector>

namespace mpuvdb::command
{

/// The word of @a known nearest to @a word, if any is near enough: by the fewest letters inserted,
/// removed or replaced, or one that begins with it. Leading dashes do not count.
std::optional<std::string> suggest(const std::string& word, const std::vector<std::string>& known);

} // namespace mpuvdb::command
