#include "indexed.h"

#include "core/parallel_each.h"

namespace mpuvdb
{
namespace
{

constexpr std::size_t kReadGrain = 1 << 14; // points; [free: the same order]

template <class T>
void permute(std::vector<T>& values, const std::vector<std::uint32_t>& order)
{
    if (values.empty()) return;
    std::vector<T> permuted(values.size());
    forEachParallel(order.size(), kReadGrain, Interrupter::silent(),
                    [&](std::size_t n) { permuted[n] = values[order[n]]; });
    values.swap(permuted);
}

} // namespace

std::shared_ptr<const PointIndex> indexOf(const PointCloud& cloud, Interrupter& progress)
{
    if (cloud.index && cloud.index->isOf(cloud.positions, progress)) return cloud.index;
    return std::make_shared<const PointIndex>(cloud.positions, progress);
}

std::shared_ptr<const PointIndex> sortPoints(PointCloud& cloud, Interrupter& progress)
{
    std::shared_ptr<const PointIndex> known = indexOf(cloud, progress);
    cloud.index.reset();
    const auto index = known.use_count() == 1 ? std::const_pointer_cast<PointIndex>(known)
                                              : std::make_shared<PointIndex>(*known);
    const std::vector<std::uint32_t>& order = index->order();
    forEachParallel(cloud.size(), kReadGrain, Interrupter::silent(),
                    [&](std::size_t n) { cloud.positions[n] = (*index)[n]; });
    permute(cloud.normals, order);
    permute(cloud.confidence, order);
    permute(cloud.colors, order);
    for (NamedScalars& s : cloud.scalars) permute(s.values, order);
    permute(cloud.seenFrom, order);
    index->followOrder();
    return index;
}

} // namespace mpuvdb
