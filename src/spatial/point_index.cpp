#include "point_index.h"

#include "key_order.h"
#include "position_order.h"

#include "core/morton.h"
#include "core/parallel_each.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <numeric>

namespace mpuvdb
{
namespace
{

constexpr std::size_t kIndexGrain = 1 << 14; // points; [free: the same results]
constexpr std::size_t kBucketPoints = 16;    // of a leaf; [free: the same results]
constexpr int kAxisBits = 21;                // [derived: three of them fill a key of 64 bits]

/// The cube about positions, in steps of a Morton key.
class KeyLattice
{
public:
    explicit KeyLattice(const std::vector<Vec3f>& positions)
    {
        Eigen::AlignedBox3f box;
        for (const Vec3f& p : positions) box.extend(p);
        if (positions.empty()) return;
        mCorner = box.min().cast<double>();
        const double side = (box.max().cast<double>() - mCorner).maxCoeff();
        mStepsPerUnit = (std::ldexp(1.0, kAxisBits) - 1) /
                        std::max(side, double(std::numeric_limits<float>::min()));
    }

    std::uint64_t keyOf(const Vec3f& p) const
    {
        const auto at = ((p.cast<double>() - mCorner) * mStepsPerUnit).cast<std::uint32_t>().eval();
        return mortonKey(at[0], at[1], at[2]);
    }

private:
    Vec3d mCorner = Vec3d::Zero();
    double mStepsPerUnit = 1;
};

/// Positions by key; where keys are equal by x, y, z, then by index.
std::vector<std::uint32_t> sortedOrder(const std::vector<Vec3f>& positions, Interrupter& progress)
{
    const KeyLattice lattice(positions);
    return orderByKeys(
        positions.size(), 3 * kAxisBits,
        [&](std::uint32_t i) { return lattice.keyOf(positions[i]); },
        [&](std::uint32_t i, std::uint32_t j) {
            return positionBefore(positions[i], positions[j]);
        },
        progress);
}

} // namespace

PointIndex::PointIndex(const std::vector<Vec3f>& positions, Interrupter& progress)
    : mOrder(sortedOrder(positions, progress)), mX(size()), mY(size()), mZ(size())
{
    forEachParallel(size(), kIndexGrain, progress, [&](std::size_t n) {
        const Vec3f& p = positions[mOrder[n]];
        mX[n] = p.x();
        mY[n] = p.y();
        mZ[n] = p.z();
    });
    makeTree();
}

void PointIndex::makeTree()
{
    std::vector<BucketTree::Bucket> buckets;
    buckets.reserve(size() / kBucketPoints + 1);
    for (std::size_t n = 0; n < size(); n += kBucketPoints)
        buckets.push_back({std::uint32_t(n), std::uint32_t(std::min(n + kBucketPoints, size()))});
    mTree = BucketTree(positions(), std::move(buckets));
}

bool PointIndex::isOf(const std::vector<Vec3f>& positions, Interrupter& progress) const
{
    if (positions.size() != size()) return false;
    std::atomic<bool> isOf{true};
    forEachParallel(size(), kIndexGrain, progress, [&](std::size_t n) {
        if ((*this)[n] != positions[mOrder[n]]) isOf = false;
    });
    return isOf;
}

void PointIndex::followOrder()
{
    std::iota(mOrder.begin(), mOrder.end(), 0u);
}

std::shared_ptr<const PointIndex> PointIndex::kept(const std::vector<std::uint8_t>& keep,
                                                   Interrupter& progress) const
{
    const auto result = std::shared_ptr<PointIndex>(new PointIndex);
    for (std::size_t n = 0; n < size(); ++n) {
        if (n % kIndexGrain == 0) progress.check();
        if (!keep[mOrder[n]]) continue;
        result->mOrder.push_back(mOrder[n]);
        result->mX.push_back(mX[n]);
        result->mY.push_back(mY[n]);
        result->mZ.push_back(mZ[n]);
    }
    result->makeTree();
    return result;
}

std::shared_ptr<const PointIndex> PointIndex::without(const std::vector<std::uint32_t>& indices,
                                                      Interrupter& progress) const
{
    std::vector<std::uint8_t> keep(size(), 1);
    for (const std::uint32_t i : indices) keep[i] = 0;
    std::vector<std::uint32_t> moved(keep.size());
    std::exclusive_scan(keep.begin(), keep.end(), moved.begin(), 0u);
    const auto result = std::const_pointer_cast<PointIndex>(kept(keep, progress));
    for (std::uint32_t& i : result->mOrder) i = moved[i];
    return result;
}

std::shared_ptr<const PointIndex> PointIndex::distinct(std::vector<std::uint32_t>& placeOf,
                                                       Interrupter& progress) const
{
    std::vector<std::uint8_t> isFirst(size());
    placeOf.resize(size());
    std::uint32_t places = 0;
    for (std::size_t n = 0; n < size(); ++n) {
        isFirst[mOrder[n]] = !isCopy(n);
        places += isCopy(n) ? 0 : 1;
        placeOf[mOrder[n]] = places - 1;
    }
    const auto result = std::const_pointer_cast<PointIndex>(kept(isFirst, progress));
    result->followOrder();
    return result;
}

void PointIndex::nearest(const Vec3f& center, std::size_t count, std::vector<Near>& found) const
{
    found.clear();
    if (count == 0) return;
    const auto before = [this](const Near& a, const Near& b) {
        return a.squared != b.squared ? a.squared < b.squared
                                      : positionBefore((*this)[a.place], (*this)[b.place]);
    };
    const auto isFull = [&] { return found.size() == count; };
    mTree.search(
        [&](std::uint32_t node) { return squaredDistanceOfNode(node, center); },
        [&] { return isFull() ? found.front().squared : std::numeric_limits<double>::infinity(); },
        [&](std::uint32_t leaf) {
            const BucketTree::Bucket& bucket = mTree.bucketOf(leaf);
            for (std::uint32_t n = bucket.begin; n < bucket.end; ++n) {
                const Near near{squaredDistance(n, center), n};
                if ((isFull() && !before(near, found.front())) || isCopy(n)) continue;
                if (isFull()) {
                    std::pop_heap(found.begin(), found.end(), before);
                    found.pop_back();
                }
                found.push_back(near);
                std::push_heap(found.begin(), found.end(), before);
            }
        });
    std::sort_heap(found.begin(), found.end(), before);
}

} // namespace mpuvdb
