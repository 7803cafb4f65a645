// How much memory the process may take.
#pragma once
#include <mpuvdb/memory.h>

#include <cstdint>
#include <string>

namespace mpuvdb::command
{

/// A size as users write it: "4G", "512M", "1.5GB", "800000000"; K, M, G, T are powers of 1024.
/// @throws UsageError for anything else, and for zero.
std::uint64_t parseSize(const std::string& text);

/// Let allocations beyond @a bytes more than now held fail (std::bad_alloc) rather than the
/// machine.
void limitMemory(std::uint64_t bytes);

/// Memory that the process holds now.
std::uint64_t residentBytes();

/// Have the C library keep what a stage frees for the next stage: given back, the system clears the
/// same pages again and again. Large arrays still go back at once. Once, before any thread starts.
void reuseFreedMemory();

} // namespace mpuvdb::command
