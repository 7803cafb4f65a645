// Refinement of a coarse field where data are missing: block by block, each a function of the level
// above and of the points near it alone.
#pragma once
#include "coarse_levels.h"

#include <functional>
#include <vector>

namespace mpuvdb
{

/// Where a coarse field is to be finer than its root grid.
struct Unseen {
    std::vector<OctreeCell> cells; ///< cubes whose fit data do not support
    double voxelSize = 0;          ///< smallest feature of interest, world units
};

class CoarseRefiner
{
public:
    /// @param noise  standard deviation of the points, world units.
    CoarseRefiner(const DipoleSource& source, const RootCube& cube, double noise)
        : mSource(source), mCube(cube), mNoise(noise)
    {
    }

    /// Value at a place, world units.
    using Value = std::function<double(const Vec3d&)>;

    /// Add levels with steps of at least @a least, world units.
    /// @param coarse  the field of @a levels so far.
    void refine(CoarseLevels& levels, const Unseen& unseen, double least, const Value& coarse,
                Interrupter& progress);
    /// The most blocks that refine() may make: more than it does.
    static std::size_t mostBlocks(const CoarseLevels& levels, const RootCube& cube,
                                  const Unseen& unseen, double least);

private:
    struct SparseData;
    struct Part;

    /// The nodes that are solved for a block.
    static Nodes nodesAbout(const CoarseLevels& levels, const Vec3i& at, int level);
    template <typename F>
    static void forEachPart(std::vector<Part>& parts, Interrupter& progress, const F& f);
    void gather(const CoarseLevels& levels, Part& part, int level, Interrupter& progress) const;
    /// Whether @a coarse, the field above, is off points in the block @a at.
    bool isMissed(const CoarseLevels& levels, const Vec3i& at, int level,
                  const Value& coarse) const;
    void solve(const CoarseLevels& levels, Part& part, int level, Interrupter& progress) const;

    const DipoleSource& mSource;
    const RootCube& mCube;
    double mNoise;
};

} // namespace mpuvdb
