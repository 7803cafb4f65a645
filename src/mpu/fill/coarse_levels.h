// The nodes of a coarse field: a root grid, and sparse levels of blocks of nodes, each level twice
// as fine as the one before.
//
// The values are coefficients of quadratic B-splines. Nodes of a level lie a quarter of a parent's
// step on both sides of each parent's node, so that the parent's spline is a spline of the level:
// where a block ends in its coefficients, value and gradient are continuous.
#pragma once
#include "splat.h"

#include <array>
#include <cstdint>
#include <vector>

namespace mpuvdb
{

class ArrayFile;
class ArrayFileWriter;

/// Index of a node in a cube of @a count of them along each axis.
inline std::size_t cubeIndex(int i, int j, int k, int count)
{
    return (std::size_t(i) * std::size_t(count) + std::size_t(j)) * std::size_t(count) +
           std::size_t(k);
}

/// A block of nodes of one level; it covers half a parent along each axis.
struct CoarseBlock {
    /// Nodes around a block that are solved with it. [derived: the solver halves the grid of a
    /// block and two halos, 32 steps, down to 2]
    static constexpr int kHalo = 8;
    /// Nodes along an edge. [derived: the rim of a block's halo is in the middle of its neighbor]
    static constexpr int kNodes = 2 * kHalo;
    /// Nodes along an edge with one more on each side. [derived: the reach of a quadratic spline]
    static constexpr int kStored = kNodes + 2;
    /// Width of the fades between blocks and at their rims, nodes. [derived: half of the halo, far
    /// from its rim]
    static constexpr int kFade = kHalo / 2;
    /// Places along an edge at which the local step is stored. [derived: one for each fade]
    static constexpr int kSteps = kNodes / kFade + 1;

    /// Local step at @a cell, coordinates of its level.
    double stepAt(const Vec3d& cell) const;

    Vec3i at; ///< its first node, blocks
    std::array<std::int32_t, 8> children{-1, -1, -1, -1, -1, -1, -1, -1}; ///< of the next level
    std::array<float, kStored * kStored * kStored> nodes;                 ///< node steps
    std::array<float, kSteps * kSteps * kSteps> steps;                    ///< world units
};

class CoarseLevels
{
public:
    CoarseLevels() = default;
    /// @param u  at the nodes of @a root.
    CoarseLevels(const Nodes& root, std::vector<float> u);

    /// The levels that save() wrote to @a file. @throws InputError.
    explicit CoarseLevels(const ArrayFile& file);
    /// @throws IoError.
    void save(ArrayFileWriter& file) const;

    const Nodes& root() const { return mRoot; }
    const std::vector<float>& rootValues() const { return mU; }
    /// Number of levels of blocks.
    int levels() const { return int(mLevels.size()); }
    double step(int level) const { return mRoot.step / double(1 << level); }
    /// Coordinates in which node i of a level is [i, i + 1).
    Vec3d cellAt(const Vec3d& p, int level) const
    {
        return ((p - mRoot.corner) / mRoot.step + Vec3d::Constant(0.5)) * double(1 << level);
    }
    /// The nearest place to cellAt(p, 0) at which splines have all their nodes.
    Vec3d clamped(const Vec3d& cell) const
    {
        const auto& n = mRoot.grid.n;
        return cell.cwiseMax(Vec3d::Constant(1.5))
            .cwiseMin(Vec3d(n[0] - 1.5, n[1] - 1.5, n[2] - 1.5));
    }
    /// The node @a n of a level, local coordinates.
    Vec3d nodeAt(const Vec3i& n, int level) const
    {
        return mRoot.corner +
               mRoot.step * ((n.cast<double>() + Vec3d::Constant(0.5)) / double(1 << level) -
                             Vec3d::Constant(0.5));
    }
    /// The finest block that holds cellAt(p, 0), or null, and its @a level and its @a index there.
    const CoarseBlock* find(const Vec3d& cell, int& level, std::size_t& index) const
    {
        if (mTop.empty()) return nullptr;
        const Vec3i top(int(cell[0]) / kTopNodes, int(cell[1]) / kTopNodes,
                        int(cell[2]) / kTopNodes);
        std::int32_t next = mTop[topIndex(top)];
        const CoarseBlock* found = nullptr;
        for (level = 0; next >= 0;) {
            index = std::size_t(next);
            found = &mLevels[std::size_t(level)][index];
            ++level;
            const double blocks = double(2 << level) / (2 * kTopNodes); // of the next level
            const int octant = (int(cell[0] * blocks) & 1) + 2 * (int(cell[1] * blocks) & 1) +
                               4 * (int(cell[2] * blocks) & 1);
            next = found->children[std::size_t(octant)];
        }
        return found;
    }
    /// Whether blocks of the first level may be @a at, with their halo.
    bool holds(const Vec3i& at) const;
    /// Whether there is the block @a at of a @a level.
    bool has(const Vec3i& at, int level) const;
    /// Step at a place, world units; continuous.
    double stepAt(const Vec3d& cell) const;
    /// Coefficients, node steps of @a level, of the @a count nodes along each axis from @a low on:
    /// of its blocks, elsewhere of the levels above.
    std::vector<float> coefficients(const Vec3i& low, int count, int level) const;
    /// Append a level; every parent has to be there.
    void add(std::vector<CoarseBlock> blocks);
    /// Undo the last add().
    void removeLast();
    std::size_t bytes() const;

private:
    /// Root nodes along an edge of a block of the first level. [derived: half of a block's]
    static constexpr int kTopNodes = CoarseBlock::kNodes / 2;

    std::size_t topIndex(const Vec3i& at) const
    {
        return (std::size_t(at[0]) * std::size_t(mTopSize[1]) + std::size_t(at[1])) *
                   std::size_t(mTopSize[2]) +
               std::size_t(at[2]);
    }
    /// Tell the parents of the last level's blocks whether these are there.
    void link(bool isThere);
    std::int32_t indexOf(const Vec3i& at, int level) const;
    std::vector<float> rootCoefficients(const Vec3i& low, int count) const;

    Nodes mRoot;
    std::vector<float> mU;
    std::vector<std::vector<CoarseBlock>> mLevels;
    std::vector<std::int32_t> mTop; ///< blocks of the first level; empty without
    Vec3i mTopSize = Vec3i::Zero();
};

} // namespace mpuvdb
