#include "core/compact.h"
#include <mpuvdb/error.h>
#include <mpuvdb/point_cloud.h>

#include <fmt/format.h>

namespace mpuvdb
{
void PointCloud::demandWhole() const
{
    const auto demand = [&](std::size_t count, const std::string& what) {
        if (count == 0 || count == size()) return;
        throw UsageError(
            fmt::format("{} points with {} {}: give one per point, or none", size(), count, what));
    };
    demand(normals.size(), "normals");
    demand(confidence.size(), "confidences");
    demand(colors.size(), "colors");
    for (const NamedScalars& s : scalars) demand(s.values.size(), "values of " + s.name);
    demand(seenFrom.size(), "viewpoints");
    for (std::size_t i = 0; i < size(); ++i)
        if (!positions[i].allFinite())
            throw InputError(fmt::format("point {} of {} is not finite: leave it out", i, size()));
    for (const std::uint32_t from : seenFrom)
        if (from != kUnseen && from >= viewpoints.size())
            throw UsageError(fmt::format("a point was seen from viewpoint {} of {}: count from 0",
                                         from, viewpoints.size()));
}

void PointCloud::compact(const std::vector<std::uint8_t>& keep)
{
    compactVector(positions, keep);
    compactVector(normals, keep);
    compactVector(confidence, keep);
    compactVector(colors, keep);
    for (NamedScalars& s : scalars) compactVector(s.values, keep);
    compactVector(seenFrom, keep);
    index.reset();
}

Box3d PointCloud::localBounds() const
{
    Box3d box;
    for (const Vec3f& p : positions) box.extend(p.cast<double>());
    return box;
}

} // namespace mpuvdb
