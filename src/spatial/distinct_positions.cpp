#include "distinct_positions.h"

#include "position_order.h"

#include <Eigen/Geometry>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <limits>

namespace mpuvdb
{
namespace
{

struct Keyed {
    std::uint64_t key;
    std::uint32_t point;
};

/// Cells within cells within cells, 32 to an edge at each of three levels.
class CellOrder
{
public:
    explicit CellOrder(const std::vector<Vec3f>& positions)
    {
        for (const Vec3f& p : positions) mBox.extend(p);
        const double size = mBox.sizes().cast<double>().maxCoeff();
        mCellsPerUnit = (kCells - 1) / std::max(size, double(std::numeric_limits<float>::min()));
    }

    std::uint64_t keyOf(const Vec3f& p) const
    {
        const Vec3i at = ((p - mBox.min()).cast<double>() * mCellsPerUnit).cast<int>();
        std::uint64_t key = 0;
        for (int level = kLevels - 1; level >= 0; --level)
            for (int axis = 0; axis < 3; ++axis)
                key = key << kBits | (std::uint64_t(at[axis]) >> (level * kBits) & (kEdge - 1));
        return key;
    }

private:
    static constexpr int kBits = 5, kLevels = 3;
    static constexpr std::uint64_t kEdge = 1u << kBits;
    static constexpr double kCells = 1 << (kBits * kLevels);
    Eigen::AlignedBox3f mBox;
    double mCellsPerUnit;
};

} // namespace

DistinctPositions::DistinctPositions(const std::vector<Vec3f>& cloud) : placeOf(cloud.size())
{
    constexpr std::size_t kGrain = 4096;
    std::vector<Keyed> sorted(cloud.size());
    const CellOrder order(cloud);
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, cloud.size(), kGrain),
                      [&](const auto& range) {
                          for (std::size_t i = range.begin(); i < range.end(); ++i)
                              sorted[i] = {order.keyOf(cloud[i]), std::uint32_t(i)};
                      });
    tbb::parallel_sort(sorted.begin(), sorted.end(), [&](const Keyed& a, const Keyed& b) {
        return a.key != b.key ? a.key < b.key : positionBefore(cloud[a.point], cloud[b.point]);
    });
    for (const Keyed& s : sorted) {
        if (positions.empty() || positions.back() != cloud[s.point])
            positions.push_back(cloud[s.point]);
        placeOf[s.point] = std::uint32_t(positions.size() - 1);
    }
}

} // namespace mpuvdb
