#include "chosen_neighbors.h"

#include "core/parallel_each.h"
#include "core/random.h"
#include "spatial/position_order.h"

#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cstring>

namespace mpuvdb
{
namespace
{

std::uint64_t hashOf(const Vec3f& p)
{
    std::uint32_t bits[3];
    const Vec3f plain = p + Vec3f::Zero(); // -0 becomes 0
    std::memcpy(bits, plain.data(), sizeof bits);
    return mixBits(mixBits((std::uint64_t(bits[0]) << 32 | bits[1]) + 1) + bits[2]);
}

/// The normal of the copies that begin at @a place: the first by x, y, z.
Vec3f normalAt(const PointCloud& cloud, const PointIndex& index, std::size_t place)
{
    if (!cloud.hasNormals()) return Vec3f::Zero();
    Vec3f first = cloud.normals[index.order()[place]];
    for (std::size_t n = place + 1; n < index.size() && index.isCopy(n); ++n) {
        const Vec3f& other = cloud.normals[index.order()[n]];
        if (positionBefore(other, first)) first = other;
    }
    return first;
}

} // namespace

std::vector<Vec3f> choosePositions(const PointIndex& index, std::size_t count,
                                   Interrupter& progress)
{
    constexpr std::size_t kChunk = 1 << 12; // points; [free: the same positions]
    std::vector<Vec3f> chosen;
    double share = double(count) / double(std::max<std::size_t>(index.size(), 1));
    // Many duplicates can leave few: then a larger share, up to all.
    for (bool enough = false; !enough; share *= 8) {
        const bool all = share >= 1;
        const std::uint64_t limit = all ? 0 : std::uint64_t(share * 0x1p64);
        const auto choose = [&](std::size_t place, std::vector<Vec3f>& found) {
            const Vec3f p = index[place];
            if ((all || hashOf(p) < limit) && !index.isCopy(place)) found.push_back(p);
        };
        chosen = gatherParallel<Vec3f>(index.size(), kChunk, progress, choose);
        enough = all || chosen.size() >= count / 4;
    }
    std::sort(chosen.begin(), chosen.end(), positionBefore);
    return chosen;
}

std::vector<Neighborhood> nearestOfChosen(const PointCloud& cloud, const PointIndex& index,
                                          const std::vector<Vec3f>& chosen, std::size_t k,
                                          Interrupter& progress)
{
    constexpr std::size_t kGrain = 16; // chosen points; [free: the same neighbors]
    std::vector<Neighborhood> neighborhoods(chosen.size());
    forEachParallel(chosen.size(), kGrain, progress, [&](std::size_t i) {
        std::vector<PointIndex::Near> found;
        index.nearest(chosen[i], k + 1, found); // the nearest is the chosen point itself
        Neighborhood& n = neighborhoods[i];
        n.center = chosen[i];
        n.normal = normalAt(cloud, index, found.front().place);
        for (std::size_t f = 1; f < found.size(); ++f)
            n.neighbors.push_back(
                {index[found[f].place], normalAt(cloud, index, found[f].place), found[f].squared});
    });
    return neighborhoods;
}

} // namespace mpuvdb
