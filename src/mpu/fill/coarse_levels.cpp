#include "coarse_levels.h"

#include "files/array_file.h"
#include <mpuvdb/error.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <type_traits>
#include <utility>

namespace mpuvdb
{
namespace
{

/// Name of the blocks of @a level in a file.
std::string blocksOf(int level)
{
    return "coarse blocks " + std::to_string(level);
}

/// The half of @a n, rounded down.
Vec3i halfOf(const Vec3i& n)
{
    return {n[0] >> 1, n[1] >> 1, n[2] >> 1};
}

/// Octant of a parent in which the block @a at is.
std::size_t octantOf(const Vec3i& at)
{
    return std::size_t((at[0] & 1) + 2 * (at[1] & 1) + 4 * (at[2] & 1));
}

/// Nodes [low, low + count) along each axis of a level from those of its parent, @a from, which
/// start at @a parentLow: the same spline [Chaikin], in steps of half the size.
std::vector<float> refined(const std::vector<float>& from, const Vec3i& parentLow, int parentCount,
                           const Vec3i& low, int count)
{
    // Node 2 j is at 3/4 of parent j and 1/4 of j - 1, node 2 j + 1 at 3/4 and 1/4 of j + 1.
    struct Pair {
        int near, far;
    };
    std::array<std::vector<Pair>, 3> pairs;
    for (int axis = 0; axis < 3; ++axis)
        for (int i = 0; i < count; ++i) {
            const int node = low[axis] + i, parent = node >> 1,
                      other = parent + (node & 1 ? 1 : -1);
            pairs[std::size_t(axis)].push_back({parent - parentLow[axis], other - parentLow[axis]});
        }
    std::vector<float> to(cubeIndex(count, 0, 0, count));
    std::vector<float> row(static_cast<std::size_t>(parentCount));
    for (int i = 0; i < count; ++i)
        for (int j = 0; j < count; ++j) {
            const Pair x = pairs[0][std::size_t(i)], y = pairs[1][std::size_t(j)];
            const float* const r[4] = {&from[cubeIndex(x.near, y.near, 0, parentCount)],
                                       &from[cubeIndex(x.near, y.far, 0, parentCount)],
                                       &from[cubeIndex(x.far, y.near, 0, parentCount)],
                                       &from[cubeIndex(x.far, y.far, 0, parentCount)]};
            for (std::size_t k = 0; k < row.size(); ++k)
                row[k] = (9 * r[0][k] + 3 * (r[1][k] + r[2][k]) + r[3][k]) / 16;
            float* const out = &to[cubeIndex(i, j, 0, count)];
            for (int k = 0; k < count; ++k) {
                const Pair z = pairs[2][std::size_t(k)];
                out[k] = 0.5f * (3 * row[std::size_t(z.near)] + row[std::size_t(z.far)]);
            }
        }
    return to;
}

} // namespace

CoarseLevels::CoarseLevels(const Nodes& root, std::vector<float> u) : mRoot(root), mU(std::move(u))
{
    for (int k = 0; k < 3; ++k) mTopSize[k] = root.grid.n[std::size_t(k)] / kTopNodes + 1;
}

CoarseLevels::CoarseLevels(const ArrayFile& file)
{
    const auto copied = [](const auto& array) {
        return std::vector<std::decay_t<decltype(array[0])>>(array.begin(), array.end());
    };
    Nodes root;
    root.grid = file.value<NodeGrid>("coarse grid");
    root.corner = file.value<Vec3d>("coarse corner");
    root.step = file.value<double>("coarse step");
    *this = CoarseLevels(root, copied(file.get<float>("coarse values")));
    if (mU.size() != root.grid.size()) throw InputError("the coarse field is damaged");
    for (int level = 1; file.has(blocksOf(level)); ++level)
        add(copied(file.get<CoarseBlock>(blocksOf(level))));
}

void CoarseLevels::save(ArrayFileWriter& file) const
{
    file.addValue("coarse grid", mRoot.grid);
    file.addValue("coarse corner", mRoot.corner);
    file.addValue("coarse step", mRoot.step);
    file.add("coarse values", mU);
    for (int level = 1; level <= levels(); ++level)
        file.add(blocksOf(level), mLevels[std::size_t(level) - 1]);
}

bool CoarseLevels::holds(const Vec3i& at) const
{
    /// Nodes of the root beyond a block on each side that its values depend on. [derived: half a
    /// halo and a spline's reach]
    constexpr int kMargin = CoarseBlock::kFade + 1;
    for (int k = 0; k < 3; ++k) {
        const int first = kTopNodes * at[k] - kMargin, last = kTopNodes * (at[k] + 1) + kMargin;
        if (first < 0 || last >= mRoot.grid.n[std::size_t(k)]) return false;
    }
    return true;
}

std::int32_t CoarseLevels::indexOf(const Vec3i& at, int level) const
{
    if (level < 1 || level > levels()) return -1;
    if (level == 1) {
        const bool outside = (at.array() < 0).any() || (at.array() >= mTopSize.array()).any();
        return outside ? -1 : mTop[topIndex(at)];
    }
    const std::int32_t parent = indexOf(halfOf(at), level - 1);
    if (parent < 0) return -1;
    return mLevels[std::size_t(level) - 2][std::size_t(parent)].children[octantOf(at)];
}

bool CoarseLevels::has(const Vec3i& at, int level) const
{
    return indexOf(at, level) >= 0;
}

double CoarseLevels::stepAt(const Vec3d& cell) const
{
    int level = 0;
    std::size_t index = 0;
    const CoarseBlock* const block = find(cell, level, index);
    return block ? block->stepAt(cell * double(1 << level)) : mRoot.step;
}

double CoarseBlock::stepAt(const Vec3d& cell) const
{
    int first[3];
    double f[3];
    for (int k = 0; k < 3; ++k) {
        const double x = (cell[k] - kNodes * at[k]) / kFade;
        first[k] = std::clamp(int(x), 0, kSteps - 2);
        f[k] = x - first[k];
    }
    double sum = 0;
    for (int corner = 0; corner < 8; ++corner) {
        double weight = 1;
        int n[3];
        for (int k = 0; k < 3; ++k) {
            const int up = corner >> k & 1;
            n[k] = first[k] + up;
            weight *= up ? f[k] : 1 - f[k];
        }
        sum += weight * double(steps[cubeIndex(n[0], n[1], n[2], kSteps)]);
    }
    return sum;
}

std::vector<float> CoarseLevels::rootCoefficients(const Vec3i& low, int count) const
{
    std::vector<float> values(cubeIndex(count, 0, 0, count));
    for (int i = 0; i < count; ++i)
        for (int j = 0; j < count; ++j)
            std::copy_n(&mU[mRoot.grid.index(low[0] + i, low[1] + j, low[2])], count,
                        &values[cubeIndex(i, j, 0, count)]);
    return values;
}

std::vector<float> CoarseLevels::coefficients(const Vec3i& low, int count, int level) const
{
    if (level == 0) return rootCoefficients(low, count);
    const Vec3i parentLow = halfOf(low) - Vec3i::Ones(),
                last = halfOf(low + Vec3i::Constant(count - 1)) + Vec3i::Ones();
    const int parentCount = (last - parentLow).maxCoeff() + 1;
    std::vector<float> values = refined(coefficients(parentLow, parentCount, level - 1), parentLow,
                                        parentCount, low, count);
    if (level > levels()) return values;
    const auto blockOf = [](int node) { return node >= 0 ? node / CoarseBlock::kNodes : -1; };
    const Vec3i high = low + Vec3i::Constant(count - 1);
    for (int bi = blockOf(low[0]); bi <= blockOf(high[0]); ++bi)
        for (int bj = blockOf(low[1]); bj <= blockOf(high[1]); ++bj)
            for (int bk = blockOf(low[2]); bk <= blockOf(high[2]); ++bk) {
                const std::int32_t index = indexOf({bi, bj, bk}, level);
                if (index < 0) continue;
                const CoarseBlock& block = mLevels[std::size_t(level) - 1][std::size_t(index)];
                const Vec3i first = CoarseBlock::kNodes * block.at;
                const Vec3i from = first.cwiseMax(low),
                            to = (first + Vec3i::Constant(CoarseBlock::kNodes - 1)).cwiseMin(high);
                for (int i = from[0]; i <= to[0]; ++i)
                    for (int j = from[1]; j <= to[1]; ++j)
                        std::copy_n(
                            &block.nodes[cubeIndex(i - first[0] + 1, j - first[1] + 1,
                                                   from[2] - first[2] + 1, CoarseBlock::kStored)],
                            to[2] - from[2] + 1,
                            &values[cubeIndex(i - low[0], j - low[1], from[2] - low[2], count)]);
            }
    return values;
}

void CoarseLevels::link(bool isThere)
{
    const std::vector<CoarseBlock>& blocks = mLevels.back();
    for (std::size_t n = 0; n < blocks.size(); ++n) {
        const Vec3i& at = blocks[n].at;
        const std::int32_t index = isThere ? std::int32_t(n) : -1;
        if (levels() == 1) {
            mTop[topIndex(at)] = index;
            continue;
        }
        const auto parent = std::size_t(indexOf(halfOf(at), levels() - 1));
        mLevels[mLevels.size() - 2][parent].children[octantOf(at)] = index;
    }
}

void CoarseLevels::add(std::vector<CoarseBlock> blocks)
{
    if (mTop.empty())
        mTop.assign(std::size_t(mTopSize[0]) * std::size_t(mTopSize[1]) * std::size_t(mTopSize[2]),
                    -1);
    mLevels.push_back(std::move(blocks));
    link(true);
}

void CoarseLevels::removeLast()
{
    link(false);
    mLevels.pop_back();
}

std::size_t CoarseLevels::bytes() const
{
    std::size_t sum = mU.capacity() * sizeof(float) + mTop.capacity() * sizeof(mTop[0]);
    for (const auto& level : mLevels) sum += level.capacity() * sizeof(CoarseBlock);
    return sum;
}

} // namespace mpuvdb
