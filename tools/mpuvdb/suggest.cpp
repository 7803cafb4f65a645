#include "suggest.h"

#include <algorithm>
#include <numeric>
#include <string_view>
#include <utility>

namespace mpuvdb::command
{
namespace
{

std::string_view withoutDashes(std::string_view word)
{
    return word.substr(std::min(word.find_first_not_of('-'), word.size()));
}

std::size_t editDistance(std::string_view a, std::string_view b)
{
    std::vector<std::size_t> row(b.size() + 1);
    std::iota(row.begin(), row.end(), std::size_t(0));
    for (std::size_t i = 0; i < a.size(); ++i) {
        std::size_t diagonal = std::exchange(row[0], i + 1);
        for (std::size_t j = 0; j < b.size(); ++j) {
            const std::size_t replaced = diagonal + (a[i] != b[j]);
            diagonal = row[j + 1];
            row[j + 1] = std::min({replaced, row[j] + 1, row[j + 1] + 1});
        }
    }
    return row.back();
}

} // namespace

std::optional<std::string> suggest(const std::string& word, const std::vector<std::string>& known)
{
    const std::string_view meant = withoutDashes(word);
    std::optional<std::string> best;
    std::size_t bestDistance = std::max<std::size_t>(2, meant.size() / 3) + 1;
    for (const std::string& candidate : known) {
        const std::string_view name = withoutDashes(candidate);
        const bool begun = meant.size() >= 3 && name.substr(0, meant.size()) == meant;
        const std::size_t distance = begun ? 1 : editDistance(meant, name);
        if (distance < bestDistance && distance < name.size()) {
            bestDistance = distance;
            best = candidate;
        }
    }
    return best;
}

} // namespace mpuvdb::command
