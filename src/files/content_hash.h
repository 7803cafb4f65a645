// Hashes of files' contents, by which damage and foreign results are noticed.
#pragma once
#include <filesystem>
#include <string>

namespace mpuvdb
{

class Interrupter;

/// Two FNV-1a hashes of the file's 64-bit words, as 32 hexadecimal digits: against damage, not
/// against forgery. @throws IoError, Interrupted.
std::string contentHash(const std::filesystem::path& file, const Interrupter& progress);

} // namespace mpuvdb
