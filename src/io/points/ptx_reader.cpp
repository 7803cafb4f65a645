// PTX: one or more scans, each a grid of rays about its scanner and a transform to the world.
#include "files/line_reader.h"
#include "files/text_scan.h"
#include "range_grid.h"
#include "readers.h"
#include "surplus.h"

#include "core/release.h"
#include <mpuvdb/error.h>

#include <fmt/format.h>

#include <algorithm>

namespace mpuvdb
{
namespace
{

class PtxReader
{
public:
    PtxReader(const ByteSource& source, Interrupter& progress)
        : mSource(source), mProgress(progress), mLines(source)
    {
    }

    FilePoints read()
    {
        FilePoints all;
        std::string_view line;
        bool normals = true;
        std::uint64_t surplus = 0;
        while (mLines.next(line)) {
            if (mRays > 0 && isRay(line)) {
                ++surplus;
                continue;
            }
            FilePoints scan = readScan(line);
            normals = normals && (scan.hasNormals() || scan.size() == 0);
            for (PointBlock& block : scan.blocks)
                if (block.size() > 0) all.blocks.push_back(std::move(block));
            for (const auto& [reason, count] : scan.dropped) all.dropped[reason] += count;
            for (const std::string& note : scan.notes)
                if (std::find(all.notes.begin(), all.notes.end(), note) == all.notes.end())
                    all.notes.push_back(note);
        }
        makeUniform(all, normals);
        noteSurplus(all, surplus, fmt::format("{} points (columns times rows)", mRays));
        return all;
    }

private:
    [[noreturn]] void throwBad(const char* what) const
    {
        throw InputError(fmt::format("{}: line {}: {}. Export the file again.", mSource.name(),
                                     mLines.line(), what));
    }

    void numbers(double* values, int count)
    {
        std::string_view line;
        if (!mLines.next(line)) throwBad("the file ends in a scan's header: it is truncated");
        LineScanner scan(line);
        for (int i = 0; i < count; ++i)
            if (!scan.number(values[i])) throwBad("a scan's header wants numbers here");
    }

    std::size_t dimension(std::string_view line) const
    {
        LineScanner scan(line);
        std::int64_t value = 0;
        if (!scan.integer(value) || value < 0 || !scan.atEnd())
            throwBad("a scan begins with its number of columns, then of rows");
        return std::size_t(value);
    }

    static bool isRay(std::string_view line)
    {
        LineScanner scan(line);
        Vec3d p;
        return scan.number(p[0]) && scan.number(p[1]) && scan.number(p[2]);
    }

    FilePoints readScan(std::string_view line)
    {
        RangeGrid grid;
        grid.columns = dimension(line);
        if (!mLines.next(line)) throwBad("the file ends in a scan's header: it is truncated");
        grid.rows = dimension(line);
        double ignored[3];
        for (int i = 0; i < 4; ++i) numbers(ignored, 3); // scanner: also in the transform below
        Eigen::Matrix<double, 4, 4, Eigen::RowMajor> transform;
        for (int row = 0; row < 4; ++row) numbers(transform.data() + 4 * row, 4);
        const std::uint64_t present = mSource.size() - mLines.offset();
        if (grid.rows > 0 && grid.columns > present / grid.rows)
            throwBad("more points are promised than the file has bytes: it is truncated");

        FilePoints scan = readRays(grid);
        grid.hasEye = true; // at the origin
        addRangeNormals(scan, grid);
        for (PointBlock& block : scan.blocks) block.seenFrom = Viewpoint(); // also without a grid
        // Points are row vectors, so that the translation is the last row.
        const Eigen::Matrix3d rotation = transform.topLeftCorner<3, 3>().transpose();
        const Vec3d translation = transform.row(3).head<3>().transpose();
        for (PointBlock& block : scan.blocks) movePoints(block, rotation, translation);
        return scan;
    }

    // Reads rays column by column; a point at the scanner's origin means that the ray hit nothing.
    FilePoints readRays(RangeGrid& grid)
    {
        const std::size_t rays = grid.columns * grid.rows;
        mRays += rays;
        struct Rows {
            PointBlock points;
            std::vector<std::uint8_t> met;
            bool colors = true;
        };
        grid.points.assign(rays, RangeGrid::kMissed);
        FilePoints scan;
        PointBlock& points = scan.joined();
        std::size_t ray = 0;
        bool colors = true;
        const std::uint64_t found = parseLines<Rows>(
            mLines, rays, mProgress,
            [&](const LineBatch& batch, Rows& rows) {
                forEachLine(batch, [&](std::string_view line, std::uint64_t number) {
                    parseRay(line, number, rows);
                });
            },
            [&](Rows&& rows) {
                auto next = std::uint32_t(points.size());
                for (const std::uint8_t met : rows.met) {
                    const std::size_t column = ray / grid.rows, row = ray % grid.rows;
                    if (met) grid.points[row * grid.columns + column] = next++;
                    ++ray;
                }
                colors = colors && rows.colors;
                points.append(std::move(rows.points));
            });
        if (found < rays) throwBad("the file ends in a scan's points: it is truncated");
        if (!colors) points.colors.clear();
        return scan;
    }

    template <class Rows>
    void parseRay(std::string_view line, std::uint64_t number, Rows& rows) const
    {
        LineScanner scan(line);
        Vec3d p;
        double values[4] = {};
        int count = 0;
        bool good = scan.number(p[0]) && scan.number(p[1]) && scan.number(p[2]);
        while (good && count < 4 && !scan.atEnd()) good = scan.number(values[count++]);
        if (!good)
            throw InputError(
                fmt::format("{}: line {}: {} is not a point of numbers. Export the file "
                            "again.",
                            mSource.name(), number, inQuotes(line)));
        const bool met = p != Vec3d::Zero();
        rows.met.push_back(met);
        if (!met) return;
        rows.points.positions.push_back(p);
        rows.points.colors.push_back(
            {colorByte(values[1]), colorByte(values[2]), colorByte(values[3])});
        rows.colors = rows.colors && count == 4; // intensity and a color
    }

    static void makeUniform(FilePoints& all, bool normals)
    {
        bool colors = true;
        for (const PointBlock& block : all.blocks) colors = colors && !block.colors.empty();
        for (PointBlock& block : all.blocks) {
            if (!normals) release(block.normals);
            if (!normals) release(block.confidence);
            if (!colors) release(block.colors);
        }
    }

    const ByteSource& mSource;
    Interrupter& mProgress;
    LineReader mLines;
    std::uint64_t mRays = 0; ///< of all scans so far
};

} // namespace

FilePoints readPtx(const ByteSource& source, const ScalarNames&, Interrupter& progress)
{
    return PtxReader(source, progress).read();
}

} // namespace mpuvdb
