#include "rounded_positions.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <fmt/format.h>

namespace mpuvdb
{

PointInput importPoints(PointArrays&& points, const std::string& name, BadPoints badPoints,
                        Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    const auto require = [&](std::size_t count, const char* what) {
        if (count != 0 && count != points.positions.size())
            throw UsageError(fmt::format("{}: {} {} for {} points. Give one for each, or none",
                                         name, count, what, points.positions.size()));
    };
    require(points.normals.size(), "normals");
    require(points.confidence.size(), "confidences");
    progress.beginStage("read");
    FilePoints input;
    input.name = name;
    PointBlock& block = input.blocks.emplace_back();
    block.positions = std::move(points.positions);
    block.normals = std::move(points.normals);
    block.confidence = std::move(points.confidence);
    if (points.viewpoint) block.seenFrom = Viewpoint{*points.viewpoint, false};
    cleanPoints(input, badPoints, progress);
    input.warnings = findRounding(input, progress);
    std::vector<FilePoints> inputs;
    inputs.push_back(std::move(input));
    PointInput result = joinPoints(std::move(inputs), badPoints, {}, progress);
    progress.endStage();
    return result;
}

} // namespace mpuvdb
