// A spline under tension through data at the nodes of a box: what of all functions near the data
// varies its curvature the least.
#pragma once
#include <array>
#include <cstddef>
#include <vector>

namespace mpuvdb
{

class Interrupter;
struct SplineRow;

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

/// Minimizes the sum of D (u - d)^2 over the nodes and the integral of
///     |grad Lap u|^2 + 2 t^2 (Lap u)^2 + t^4 |grad u|^2
/// over the box, for data d of weight D and a tension t: a curvature goes on for about 1 / t steps
/// beyond its data, a slope somewhat farther, and from there on u is harmonic and has no extremum.
///
/// The equation  -Lap (t^2 - Lap)^2 u + D (u - d) = 0  is solved as one of second order for u, its
/// Laplacian and the Laplacian of that: full multigrid, red-black relaxation of the three together,
/// so that the result does not depend on the number of threads.
class TensionSpline
{
public:
    /// Reciprocal of the distance over which curvature goes on beyond data, node steps. With less,
    /// creases of dense data throw sheets into free space. [tuned: unseen_bench, pieces too: 0.2
    /// has such sheets, 0.25 has none and is 7 % nearer to what nobody saw]
    static constexpr float kTension = 0.3f;

    /// Least weight of data: twice the cube of the 6 of a Laplacian's diagonal. [derived: local
    /// Fourier analysis; relaxation amplifies some waves where the weight is below that cube]
    static constexpr float kMinWeight = 432;

    /// @param weight  D, one per node: 0, or at least kMinWeight. Each dimension of @a grid is
    /// 8 a + 1.
    TensionSpline(const NodeGrid& grid, std::vector<float> weight, Interrupter& progress);

    /// The values u at all nodes.
    /// @param data  d; not read where the weight is 0.
    /// @param border  u on the box's nodes; others are not read.
    /// @param bend  Laplacian of u on the box's nodes, per square of a step; others are not read.
    /// Empty: 0.
    /// @param cycles  V-cycles on the finest level after the full multigrid pass.
    std::vector<float> solve(std::vector<float> data, const std::vector<float>& border,
                             const std::vector<float>& bend, int cycles);

private:
    /// The unknowns u, Lap u and Lap Lap u, or the right-hand sides of their equations.
    using Three = std::array<std::vector<float>, 3>;
    /// Of its arrays each row has the even nodes first, then the odd ones.
    struct Level {
        NodeGrid grid;
        float step;                ///< steps of the finest grid
        std::vector<float> weight; ///< mean of the nodes' around
        Three u;                   ///< unknowns, in steps of the finest grid
        Three b;                   ///< right-hand sides; empty where they are 0
    };

    void fillBorder(std::size_t level, const std::vector<float>& border,
                    std::vector<float>& u) const;
    void cycle(std::size_t level);
    void relax(Level& level, int sweeps) const;
    /// Make the residuals of @a fine the right-hand sides of @a coarse.
    void restrictResidual(Level& fine, Level& coarse);
    SplineRow rowOf(Level& level, int i, int j, bool odd) const;

    std::vector<Level> mLevels;   ///< finest first
    std::vector<float> mNone;     ///< a row of zeros
    std::vector<float> mResidual; ///< of one equation
    Interrupter& mProgress;
};

} // namespace mpuvdb
