// Files that stand where another one was meant to be.
#pragma once
#include <string>
#include <string_view>

namespace mpuvdb
{

/// @throws InputError that says what the file is, and how to come by the one that was meant, if it
/// begins as a Git LFS pointer, a web page, an archive, text in UTF-16, or as a format that has to
/// be converted. @param head  its first 256 bytes, or all there are.
void refuseStandIns(const std::string& file, std::string_view head);

} // namespace mpuvdb
