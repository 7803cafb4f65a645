// Points from memory.
#include "raw_points.h"
#include "rounded_positions.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <fmt/format.h>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

/// Calls @a use(numbers, n) for the n-th of @a rows of @a view, or of all, where numbers points to
/// the row's numbers in their own type; in parallel.
template <class Use>
void forEachRow(const NumberView& view, const std::vector<std::uint32_t>* rows, const Use& use)
{
    const std::size_t count = rows ? rows->size() : view.rows;
    const auto go = [&](auto number) {
        using Number = decltype(number);
        tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, kPointsPerSlice),
                          [&](const auto& range) {
                              for (std::size_t n = range.begin(); n != range.end(); ++n)
                                  use(view.row<Number>(rows ? (*rows)[n] : n), n);
                          });
    };
    switch (view.type) {
    case NumberView::Type::Float:
        return go(float());
    case NumberView::Type::Double:
        return go(double());
    case NumberView::Type::Byte:
        return go(std::uint8_t());
    }
}

template <class Vector>
std::vector<Vector> vectorsOf(const NumberView& view, const std::vector<std::uint32_t>* rows)
{
    std::vector<Vector> vectors(view.empty() ? 0 : rows ? rows->size() : view.rows);
    using Scalar = typename Vector::Scalar;
    if (!vectors.empty())
        forEachRow(view, rows, [&](const auto* row, std::size_t n) {
            vectors[n] = Vector(Scalar(row[0]), Scalar(row[1]), Scalar(row[2]));
        });
    return vectors;
}

std::vector<float> numbersOf(const NumberView& view, const std::vector<std::uint32_t>* rows)
{
    std::vector<float> numbers(view.empty() ? 0 : rows ? rows->size() : view.rows);
    if (!numbers.empty())
        forEachRow(view, rows, [&](const auto* row, std::size_t n) { numbers[n] = float(*row); });
    return numbers;
}

std::vector<Rgb> bytesOf(const NumberView& view, const std::vector<std::uint32_t>* rows)
{
    std::vector<Rgb> colors(view.empty() ? 0 : rows ? rows->size() : view.rows);
    if (!colors.empty())
        forEachRow(view, rows, [&](const auto* row, std::size_t n) {
            for (std::size_t c = 0; c < 3; ++c) colors[n][c] = colorByte(double(row[c]));
        });
    return colors;
}

/// @param rows  of the points that become the block; null: all.
PointBlock blockOf(const PointView& points, const std::vector<std::uint32_t>* rows)
{
    PointBlock block;
    block.positions = vectorsOf<Vec3d>(points.positions, rows);
    block.normals = vectorsOf<Vec3f>(points.normals, rows);
    block.confidence = numbersOf(points.confidences, rows);
    if (points.colors.type == NumberView::Type::Byte)
        block.colors = bytesOf(points.colors, rows);
    else
        block.rawColors = vectorsOf<Vec3f>(points.colors, rows);
    for (std::size_t n = 0; n < points.scalars.size(); ++n)
        block.scalars[n] = numbersOf(points.scalars[n].second, rows);
    return block;
}

void requireRows(const PointView& points, const std::string& name)
{
    const auto require = [&](const NumberView& view, const std::string& what, std::size_t width) {
        if (view.empty()) return;
        if (view.columns != width)
            throw UsageError(fmt::format("{}: each of the {} has {} numbers, and not {}", name,
                                         what, view.columns, width));
        if (view.rows != points.positions.rows)
            throw UsageError(fmt::format("{}: {} {} for {} points. Give one for each, or none",
                                         name, view.rows, what, points.positions.rows));
    };
    require(points.positions, "positions", 3);
    require(points.normals, "normals", 3);
    require(points.confidences, "confidences", 1);
    require(points.colors, "colors", 3);
    for (const Vec3d& viewpoint : points.viewpoints)
        if (!viewpoint.allFinite())
            throw UsageError(name + ": a viewpoint is not finite. Leave it out");
    if (points.scalars.size() > kMaxScalars)
        throw UsageError(fmt::format("{}: {} scalars are more than {}. Leave some out", name,
                                     points.scalars.size(), kMaxScalars));
    for (const auto& [scalar, view] : points.scalars) {
        if (scalar.empty() || view.empty())
            throw UsageError(name + ": a scalar has no name, or no values. Give both");
        // What is no attribute of the surface, as radii, is named with a blank before.
        require(view, "values of '" + scalar.substr(scalar.front() == ' ') + "'", 1);
    }
    if (points.positions.rows > std::numeric_limits<std::uint32_t>::max())
        throw LimitError(fmt::format("{}: {} points are more than 4294967295. Thin them, or work "
                                     "on parts",
                                     name, points.positions.rows));
}

/// A block for each viewpoint, or one for all.
std::vector<PointBlock> blocksOf(const PointView& points, const std::string& name)
{
    std::vector<PointBlock> blocks;
    if (!points.seenFrom) {
        blocks.push_back(blockOf(points, nullptr));
        if (!points.viewpoints.empty())
            blocks.back().seenFrom = Viewpoint{points.viewpoints.front(), false};
        return blocks;
    }
    std::vector<std::vector<std::uint32_t>> seen(points.viewpoints.size());
    for (std::size_t i = 0; i < points.positions.rows; ++i) {
        if (points.seenFrom[i] >= seen.size())
            throw UsageError(fmt::format("{}: point {} was seen from viewpoint {}, and there are "
                                         "{}. Count from 0",
                                         name, i, points.seenFrom[i], seen.size()));
        seen[points.seenFrom[i]].push_back(std::uint32_t(i));
    }
    for (std::size_t v = 0; v < seen.size(); ++v) {
        if (seen[v].empty()) continue;
        blocks.push_back(blockOf(points, &seen[v]));
        blocks.back().seenFrom = Viewpoint{points.viewpoints[v], false};
    }
    return blocks;
}

} // namespace

PointInput importPoints(const PointView& points, const std::string& name, BadPoints badPoints,
                        Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    requireRows(points, name);
    progress.beginStage("read");
    FilePoints input;
    input.name = name;
    input.blocks = blocksOf(points, name);
    ScalarNames scalars;
    for (const auto& scalar : points.scalars) scalars.push_back(scalar.first);
    input.scalarNames = scalars;
    cleanPoints(input, badPoints, progress);
    scaleColors(input, progress);
    if (const auto warning = findRounding(input, progress)) input.warnings.push_back(*warning);
    std::vector<FilePoints> inputs;
    inputs.push_back(std::move(input));
    PointInput result = joinPoints(std::move(inputs), badPoints, scalars, progress);
    progress.endStage();
    return result;
}

} // namespace mpuvdb
