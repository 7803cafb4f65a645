// Placeholders, and files of formats that are not read.
#pragma once
#include <string>
#include <string_view>

namespace mpuvdb
{

/// Refuses a file that begins as a Git LFS pointer, a web page, an archive, text in UTF-16, or a
/// format that has to be converted. @throws InputError with what it is, and the cure.
/// @param head  its first 256 bytes, or all there are.
void refuseStandIns(const std::string& file, std::string_view head);

} // namespace mpuvdb
