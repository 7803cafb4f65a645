#include <mpuvdb/error.h>
#include <mpuvdb/point_cloud.h>

#include <fmt/format.h>

namespace mpuvdb
{
namespace
{

template <class T>
void keepMarked(std::vector<T>& values, const std::vector<std::uint8_t>& keep)
{
    if (values.empty()) return;
    std::size_t kept = 0;
    for (std::size_t i = 0; i < keep.size(); ++i)
        if (keep[i]) values[kept++] = values[i];
    values.resize(kept);
}

} // namespace

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
}

void PointCloud::compact(const std::vector<std::uint8_t>& keep)
{
    keepMarked(positions, keep);
    keepMarked(normals, keep);
    keepMarked(confidence, keep);
    keepMarked(colors, keep);
    for (NamedScalars& s : scalars) keepMarked(s.values, keep);
    keepMarked(seenFrom, keep);
}

Box3d PointCloud::localBounds() const
{
    Box3d box;
    for (const Vec3f& p : positions) box.extend(p.cast<double>());
    return box;
}

} // namespace mpuvdb
