#include "lzf.h"

#include <algorithm>

namespace mpuvdb
{

// A control byte below 32 announces that many literal bytes plus one. Else its upper three bits are
// the length of an earlier run minus two (7: the next byte is added), its lower five with the byte
// after them how far back the run begins, minus one.
bool lzfDecompress(const char* packed, std::size_t packedBytes, char* to, std::size_t bytes)
{
    std::size_t in = 0, out = 0;
    while (in < packedBytes) {
        const auto control = static_cast<unsigned char>(packed[in++]);
        if (control < 32) {
            const std::size_t length = control + 1u;
            if (length > packedBytes - in || length > bytes - out) return false;
            std::copy_n(packed + in, length, to + out);
            in += length;
            out += length;
            continue;
        }
        std::size_t length = control >> 5;
        if (packedBytes - in < (length == 7 ? 2u : 1u)) return false;
        if (length == 7) length += static_cast<unsigned char>(packed[in++]);
        length += 2;
        const std::size_t back =
            (std::size_t(control & 31) << 8) + static_cast<unsigned char>(packed[in++]) + 1;
        if (back > out || length > bytes - out) return false;
        for (std::size_t i = 0; i < length; ++i, ++out) to[out] = to[out - back]; // may overlap
    }
    return out == bytes;
}

} // namespace mpuvdb
