// Exact copies of points, found by hashing in parts whose tables fit a cache.
#include "raw_points.h"

#include <mpuvdb/interrupter.h>

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstring>
#include <memory>
#include <utility>

namespace mpuvdb
{
namespace
{

constexpr std::uint32_t kEmpty = 0xffffffffu; ///< an empty slot [derived: the largest]
constexpr std::size_t kPartPoints = 8192;     ///< points in a part [free: cache size]
constexpr std::size_t kSlices = 16;           ///< slices that are scattered [free: grain size]

std::uint64_t mix(std::uint64_t h, std::uint64_t value)
{
    h = (h ^ value) * 0x9e3779b97f4a7c15ull;
    return h ^ (h >> 29);
}

std::uint64_t hashOf(const Vec3f& v, std::uint64_t h)
{
    std::uint32_t bits[3];
    const Vec3f plusZero = v + Vec3f::Zero(); // -0 equals 0
    std::memcpy(bits, plusZero.data(), sizeof bits);
    return mix(mix(h, bits[0] | std::uint64_t(bits[1]) << 32), bits[2]);
}

std::uint64_t hashOf(const PointCloud& cloud, std::size_t i)
{
    std::uint64_t h = hashOf(cloud.positions[i], 0x2545f4914f6cdd1dull);
    if (!cloud.normals.empty()) h = hashOf(cloud.normals[i], h);
    return mix(h, h >> 32);
}

bool sameScalars(const PointCloud& cloud, std::size_t i, std::size_t j)
{
    return std::all_of(
        cloud.scalars.begin(), cloud.scalars.end(),
        [=](const NamedScalars& scalars) { return scalars.values[i] == scalars.values[j]; });
}

bool same(const PointCloud& cloud, std::size_t i, std::size_t j)
{
    return cloud.positions[i] == cloud.positions[j] &&
           (cloud.normals.empty() || cloud.normals[i] == cloud.normals[j]) &&
           (cloud.confidence.empty() || cloud.confidence[i] == cloud.confidence[j]) &&
           (cloud.colors.empty() || cloud.colors[i] == cloud.colors[j]) && sameScalars(cloud, i, j);
}

// Points with their hashes' upper halves, grouped by the uppermost bits.
struct Parts {
    std::unique_ptr<std::uint64_t[]> keys; ///< upper half of the hash, index below
    std::vector<std::size_t> starts;       ///< of each part in keys, and the end
};

// Counts and scatters slice by slice, the slices in order, so that threads do not change the
// result.
Parts partition(const PointCloud& cloud)
{
    const std::size_t points = cloud.size();
    int bits = 0;
    while (bits < 16 && (points >> bits) > kPartPoints) ++bits;
    const std::size_t parts = std::size_t(1) << bits;
    const auto partOf = [&](std::uint32_t hash) {
        return std::size_t(std::uint64_t(hash) << bits >> 32);
    };
    const auto sliceStart = [&](std::size_t slice) { return points * slice / kSlices; };
    const auto forEachHash = [&](std::size_t slice, const auto& f) {
        for (std::size_t i = sliceStart(slice); i < sliceStart(slice + 1); ++i)
            f(i, std::uint32_t(hashOf(cloud, i) >> 32));
    };

    std::vector<std::vector<std::size_t>> next(kSlices, std::vector<std::size_t>(parts, 0));
    tbb::parallel_for(std::size_t(0), kSlices, [&](std::size_t slice) {
        forEachHash(slice, [&](std::size_t, std::uint32_t hash) { ++next[slice][partOf(hash)]; });
    });
    Parts result;
    std::size_t start = 0;
    for (std::size_t part = 0; part < parts; ++part) {
        result.starts.push_back(start);
        for (auto& slice : next) start += std::exchange(slice[part], start);
    }
    result.starts.push_back(start);
    result.keys.reset(new std::uint64_t[points]); // not cleared: every one is written
    adviseLargePages(result.keys.get(), points * sizeof(std::uint64_t));
    tbb::parallel_for(std::size_t(0), kSlices, [&](std::size_t slice) {
        forEachHash(slice, [&](std::size_t i, std::uint32_t hash) {
            result.keys[next[slice][partOf(hash)]++] = std::uint64_t(hash) << 32 | i;
        });
    });
    return result;
}

// Clears the flag of every point of keys[begin, end) that equals one before it.
void markPart(const PointCloud& cloud, const std::uint64_t* keys, std::size_t begin,
              std::size_t end, std::vector<std::uint8_t>& keep)
{
    std::size_t slots = 16;
    while (slots < 2 * (end - begin)) slots *= 2;
    std::vector<std::uint32_t> table(slots, kEmpty); // places in keys, from begin
    for (std::size_t k = begin; k < end; ++k) {
        // The uppermost bits chose the part: the place comes from the ones below, multiplied apart.
        std::size_t slot = std::size_t((keys[k] >> 32) * 0x9e3779b1u >> 8) & (slots - 1);
        for (; table[slot] != kEmpty; slot = (slot + 1) & (slots - 1)) {
            const std::uint64_t other = keys[begin + table[slot]];
            if (other >> 32 == keys[k] >> 32 &&
                same(cloud, std::uint32_t(other), std::uint32_t(keys[k])))
                break;
        }
        if (table[slot] == kEmpty)
            table[slot] = std::uint32_t(k - begin);
        else
            keep[std::uint32_t(keys[k])] = 0;
    }
}

} // namespace

std::uint64_t dropDuplicates(PointCloud& cloud, Interrupter& progress)
{
    const std::size_t points = cloud.size();
    std::vector<std::uint8_t> keep(points, 1);
    {
        const Parts parts = partition(cloud);
        tbb::parallel_for(std::size_t(0), parts.starts.size() - 1, [&](std::size_t p) {
            progress.check();
            markPart(cloud, parts.keys.get(), parts.starts[p], parts.starts[p + 1], keep);
        });
    }
    std::uint64_t dropped = 0;
    for (const std::uint8_t k : keep) dropped += k == 0;
    if (dropped == 0) return 0;
    cloud.compact(keep);
    return dropped;
}

} // namespace mpuvdb
