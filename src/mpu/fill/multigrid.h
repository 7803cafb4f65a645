// A multigrid solver for screened Poisson equations on a box of nodes.
#pragma once
#include <array>
#include <cstddef>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// Dimensions of a node grid; node (i,j,k) is element (i ny + j) nz + k.
struct NodeGrid {
    std::array<int, 3> n{};

    std::size_t size() const { return std::size_t(n[0]) * std::size_t(n[1]) * std::size_t(n[2]); }
    std::size_t index(int i, int j, int k) const
    {
        return (std::size_t(i) * std::size_t(n[1]) + std::size_t(j)) * std::size_t(n[2]) +
               std::size_t(k);
    }
    /// Step from one node of the row (i, j) that is on the box to the next, from k = 0 on.
    int borderStep(int i, int j) const
    {
        const bool whole = i == 0 || j == 0 || i == n[0] - 1 || j == n[1] - 1;
        return whole ? 1 : n[2] - 1;
    }
};

/// Solves (Lap - D) u = b in grid units, u = border on the box: full multigrid, red-black
/// relaxation, so that the result does not depend on the number of threads.
class ScreenedPoisson
{
public:
    /// @param screening  D >= 0, one per node. Each dimension of @a grid is 8 a + 1.
    ScreenedPoisson(const NodeGrid& grid, std::vector<float> screening, Interrupter& progress);

    /// Solve the equation; returns u. @param border  u on the box's nodes; others are not read.
    /// @param cycles  V-cycles on the finest level after the full multigrid pass; 0: two sweeps.
    std::vector<float> solve(std::vector<float> b, const std::vector<float>& border, int cycles);
    /// solve() with one value on the whole box.
    std::vector<float> solve(std::vector<float> b, float border, int cycles);

private:
    struct Level {
        NodeGrid grid;
        std::vector<float> screening, u, b;
    };
    void descendRightHandSide(std::vector<float> b);
    void fillBorder(std::size_t level, const std::vector<float>& border);
    void cycle(std::size_t level);
    void relax(Level& level, int sweeps) const;

    std::vector<Level> mLevels; ///< finest first
    Interrupter& mProgress;
};

} // namespace mpuvdb
