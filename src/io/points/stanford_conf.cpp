// Stanford scan sets: the scans and their motions.
#include "files/line_reader.h"
#include "files/text_scan.h"
#include "readers.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>

namespace mpuvdb
{
namespace
{

[[noreturn]] void throwBad(const ByteSource& source, std::uint64_t line, const std::string& what)
{
    throw InputError(fmt::format("{}: line {}: {}.", source.name(), line, what));
}

// FILE tx ty tz qx qy qz qw. The quaternion is that of the inverse rotation.
PlacedScan parseScan(const ByteSource& source, std::uint64_t line, LineScanner& scan)
{
    PlacedScan placed;
    placed.file = std::string(scan.word());
    double v[7];
    for (double& value : v)
        if (!scan.number(value) || !(std::abs(value) < 1e15))
            throwBad(source, line, "wants 'bmesh FILE tx ty tz qx qy qz qw'");
    const Eigen::Quaterniond turn(v[6], v[3], v[4], v[5]);
    if (placed.file.empty() || !(turn.norm() > 1e-6))
        throwBad(source, line, "the rotation's quaternion is zero");
    placed.rotation = turn.normalized().conjugate().toRotationMatrix();
    placed.translation = Vec3d(v[0], v[1], v[2]);
    return placed;
}

} // namespace

std::vector<PlacedScan> readScanSet(const std::filesystem::path& file,
                                    std::vector<std::string>& notes, Interrupter& progress)
{
    const ByteSource source(file, progress);
    LineReader lines(source);
    std::vector<PlacedScan> scans;
    std::string_view line;
    while (lines.next(line)) {
        progress.check();
        LineScanner scan(line);
        if (scan.atEndOrComment()) continue;
        const std::string_view keyword = scan.word();
        if (keyword == "camera") continue; // of a viewer
        if (keyword != "bmesh" && keyword != "mesh")
            throwBad(source, lines.line(),
                     fmt::format("{} is not known; wants 'camera', 'mesh' or 'bmesh'",
                                 inQuotes(keyword)));
        PlacedScan placed = parseScan(source, lines.line(), scan);
        const std::filesystem::path listed = placed.file;
        placed.file = file.parent_path() / listed;
        std::error_code error;
        if (!std::filesystem::exists(placed.file, error)) {
            if (listed.has_extension())
                throw IoError(
                    fmt::format("{}: line {}: the scan {} is not there. Put it beside the "
                                "set, or take the line out.",
                                source.name(), lines.line(), placed.file.string()));
            notes.push_back(
                fmt::format("lists {}, which is not there, and left out", listed.string()));
            continue;
        }
        scans.push_back(std::move(placed));
    }
    if (scans.empty()) throwBad(source, lines.line(), "the set lists no scans that are there");
    if (source.commas() == Commas::Decimal) notes.push_back("its numbers have decimal commas");
    return scans;
}

} // namespace mpuvdb
