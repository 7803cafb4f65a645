// One reader per format. All throw InputError for malformed input, with the place and the cure,
// take memory in proportion to the bytes present, and can be stopped. PLY, PCD, LAS and named
// columns have scalars; the others have none.
#pragma once
#include "files/byte_source.h"
#include "points/import/raw_points.h"

namespace mpuvdb
{

FilePoints readPly(const ByteSource& source, const ScalarNames& scalars, Interrupter& progress);
/// XYZ, PWN, TXT, CSV: numbers in columns, whose meaning follows from names or values.
FilePoints readColumns(const ByteSource& source, const ScalarNames& scalars, Interrupter& progress);
/// PTS: such columns, with an intensity before a color.
FilePoints readPwn(const ByteSource& source, const ScalarNames& scalars, Interrupter& progress);
FilePoints readPts(const ByteSource& source, const ScalarNames& scalars, Interrupter& progress);
FilePoints readPtx(const ByteSource& source, const ScalarNames& scalars, Interrupter& progress);
FilePoints readObj(const ByteSource& source, const ScalarNames& scalars, Interrupter& progress);
FilePoints readOff(const ByteSource& source, const ScalarNames& scalars, Interrupter& progress);
FilePoints readStl(const ByteSource& source, const ScalarNames& scalars, Interrupter& progress);
FilePoints readPcd(const ByteSource& source, const ScalarNames& scalars, Interrupter& progress);
FilePoints readLas(const ByteSource& source, const ScalarNames& scalars, Interrupter& progress);

/// Points and triangles as the file has them, by the reader for its first bytes or its extension,
/// with those of the @a scalars that it has.
FilePoints readFormat(const std::filesystem::path& file, const ScalarNames& scalars,
                      Interrupter& progress);

/// A scan of a Stanford .conf set: world = rotation * p + translation.
struct PlacedScan {
    std::filesystem::path file;
    Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
    Vec3d translation = Vec3d::Zero();
};
/// The scans of a set that exist. Missing ones named without an extension go to @a notes:
/// Stanford's sets list cylindrical scans that were never published.
std::vector<PlacedScan> readScanSet(const std::filesystem::path& file,
                                    std::vector<std::string>& notes, Interrupter& progress);

} // namespace mpuvdb
