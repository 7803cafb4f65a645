// The memory limit of the process.
#pragma once
#include <mpuvdb/memory.h>

#include <cstdint>
#include <string>

namespace mpuvdb::command
{

/// A size as users write it: "4G", "512M", "1.5GB", "800000000"; K, M, G, T are powers of 1024.
/// @throws UsageError for anything else, and for zero.
std::uint64_t parseSize(const std::string& text);

/// Makes allocations of more than @a bytes beside those held now fail with std::bad_alloc.
void limitMemory(std::uint64_t bytes);

/// The private writable memory of the process, bytes, which limitMemory() limits.
std::uint64_t dataBytes();

/// The resident memory of the process, bytes.
std::uint64_t residentBytes();

/// Makes the C library keep memory that a stage frees for the next one, as the system would clear
/// its pages again; large arrays are still given back at once. Call it before any thread starts.
void reuseFreedMemory();

} // namespace mpuvdb::command
