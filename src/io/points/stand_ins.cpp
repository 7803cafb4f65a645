#include "stand_ins.h"

#include "files/text_scan.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>

#include <algorithm>

namespace mpuvdb
{
namespace
{

struct StandIn {
    std::string_view begins; ///< in lower case
    const char* isA;
    const char* cure;
};

constexpr StandIn kStandIns[] = {
    {"version https://git-lfs", "a Git LFS pointer, not the file that it stands for",
     "Fetch that with 'git lfs pull'"},
    {"<!doctype html", "a web page", "Download the file itself: its address may want a login"},
    {"<html", "a web page", "Download the file itself: its address may want a login"},
    {"<?xml", "XML, perhaps what a server answered instead of the file", "Download it again"},
    {"astm-e57", "an E57 file, which cannot be read yet",
     "Convert it first, for example with 'pdal translate in.e57 out.las'"},
    {"pk\x03\x04", "a ZIP archive", "Unpack it first"},
    {"\x1f\x8b", "compressed (gzip)", "Unpack it first: gunzip"},
    {"bzh", "compressed (bzip2)", "Unpack it first: bunzip2"},
    {"\xfd\x37zxz", "compressed (xz)", "Unpack it first: unxz"},
    {"\x28\xb5\x2f\xfd", "compressed (zstd)", "Unpack it first: unzstd"},
};

/// Whether this is text of two-byte characters: by its mark, or as every other byte is 0.
bool isUtf16(std::string_view head)
{
    if (head.substr(0, 2) == "\xff\xfe" || head.substr(0, 2) == "\xfe\xff") return true;
    if (head.size() < 16) return false;
    for (const std::size_t first : {0, 1}) {
        bool all = true;
        for (std::size_t i = 0; i < head.size(); ++i)
            all = all && (head[i] == 0) == (i % 2 == first);
        if (all) return true;
    }
    return false;
}

} // namespace

void refuseStandIns(const std::string& file, std::string_view head)
{
    if (isUtf16(head))
        throw InputError(fmt::format("{}: is text in UTF-16. Save it as UTF-8, for example with "
                                     "'iconv -f UTF-16 -t UTF-8 in > out'.",
                                     file));
    std::string_view text = head;
    if (text.substr(0, 3) == "\xef\xbb\xbf") text.remove_prefix(3);
    while (!text.empty() && (isSeparator(text.front()) || text.front() == '\n'))
        text.remove_prefix(1);
    const std::string begin = lowerCase(text.substr(0, 32));
    for (const StandIn& s : kStandIns)
        if (begin.compare(0, s.begins.size(), s.begins) == 0)
            throw InputError(fmt::format("{}: is {}. {}.", file, s.isA, s.cure));
}

} // namespace mpuvdb
