// The pages of mapped files that the process has touched: they count as its memory until it lets
// go of them, though the system may take them back at any time.
#pragma once
#include <cstddef>

namespace mpuvdb
{

/// Count @a bytes at @a data, a shared mapping of a file, among those of forgetMappedPages().
void keepTrackOfPages(const void* data, std::size_t bytes);
/// The mapping at @a data is about to end.
void loseTrackOfPages(const void* data);

/// Let go of the pages of all these mappings. What was written stays in the file, or on its way to
/// it; what is used again comes back from there, or from the system's cache.
void forgetMappedPages();

} // namespace mpuvdb
