#include "content_hash.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <fmt/format.h>
#include <fstream>
#include <vector>

namespace mpuvdb
{

std::string contentHash(const std::filesystem::path& file, const Interrupter& progress)
{
    std::ifstream in(file, std::ios::binary);
    if (!in) throw IoError(fmt::format("{}: cannot be read", file.string()));
    std::array<std::uint64_t, 2> hash = {0xcbf29ce484222325u, 0x6c62272e07bb0142u};
    std::vector<std::uint64_t> words(1 << 16);
    for (;;) {
        progress.check();
        std::fill(words.begin(), words.end(), 0);
        in.read(reinterpret_cast<char*>(words.data()),
                std::streamsize(words.size() * sizeof words[0]));
        const auto bytes = std::size_t(in.gcount());
        if (bytes == 0) break;
        for (std::size_t w = 0; w * sizeof words[0] < bytes; ++w)
            hash[w % 2] = (hash[w % 2] ^ words[w]) * 0x100000001b3u ^ (hash[w % 2] >> 29);
        hash[1] ^= bytes; // so that zeros at the end count
    }
    if (in.bad()) throw IoError(fmt::format("{}: cannot be read to its end", file.string()));
    return fmt::format("{:016x}{:016x}", hash[0], hash[1]);
}

} // namespace mpuvdb
