#include "fill_cavities.h"

#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <unordered_set>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using openvdb::FloatTree;

/// Voxels between two checks of the interrupter. [free: latency]
constexpr std::size_t kCheckStride = 1 << 12;

using Voxels = std::unordered_set<Coord>;

template <typename F>
void forEachFaceNeighbor(const Coord& at, F f)
{
    for (int n = 0; n < 6; ++n) {
        Coord side = at;
        side[n / 2] += n % 2 ? 1 : -1;
        f(side);
    }
}

class CavityFiller
{
public:
    CavityFiller(FloatTree& tree, Fill&& fill, Interrupter& progress)
        : mAccess(tree), mFill(std::move(fill)), mProgress(progress)
    {
        std::sort(mFill.voxels.begin(), mFill.voxels.end());
        mSide = mAccess.getValue(mFill.voxels.front()) < 0;
    }

    std::vector<Coord> fill()
    {
        std::vector<Coord> wrong = unattached();
        const std::vector<Coord> closed = cavities();
        wrong.insert(wrong.end(), closed.begin(), closed.end());
        for (const Coord& at : wrong) mAccess.setValueOn(at, -mAccess.getValue(at));
        return wrong;
    }

private:
    /// No index. [derived: the largest of its type]
    static constexpr std::size_t kNone = ~std::size_t(0);

    /// The index of a voxel among the filled; kNone if it is not.
    std::size_t find(const Coord& at) const
    {
        const auto place = std::lower_bound(mFill.voxels.begin(), mFill.voxels.end(), at);
        return place != mFill.voxels.end() && *place == at
                   ? std::size_t(place - mFill.voxels.begin())
                   : kNone;
    }
    bool isFilledSide(const Coord& at) const { return (mAccess.getValue(at) < 0) == mSide; }

    /// The filled voxels that are not connected to the solids.
    std::vector<Coord> unattached()
    {
        const auto& filled = mFill.voxels;
        std::vector<char> isAttached(filled.size(), false);
        std::vector<std::size_t> stack;
        for (std::size_t n = 0; n < filled.size(); ++n) {
            if (n % kCheckStride == 0) mProgress.check();
            forEachFaceNeighbor(filled[n], [&](const Coord& side) {
                if (isAttached[n] || !isFilledSide(side) || find(side) != kNone) return;
                isAttached[n] = true;
                stack.push_back(n);
            });
        }
        for (std::size_t steps = 0; !stack.empty(); ++steps) {
            if (steps % kCheckStride == 0) mProgress.check();
            const Coord at = filled[stack.back()];
            stack.pop_back();
            forEachFaceNeighbor(at, [&](const Coord& side) {
                const std::size_t n = find(side);
                if (n == kNone || isAttached[n]) return;
                isAttached[n] = true;
                stack.push_back(n);
            });
        }
        std::vector<Coord> found;
        for (std::size_t n = 0; n < filled.size(); ++n)
            if (!isAttached[n]) found.push_back(filled[n]);
        return found;
    }

    /// The voxels of cavities that the fill leaves between the solids, where the ball does not fit.
    std::vector<Coord> cavities()
    {
        Voxels known;
        std::vector<Coord> found;
        for (std::size_t n = 0; n < mFill.voxels.size(); ++n) {
            if (n % kCheckStride == 0) mProgress.check();
            forEachFaceNeighbor(mFill.voxels[n], [&](const Coord& side) {
                if (isFilledSide(side) || known.count(side)) return;
                std::vector<Coord> reached;
                if (isCavity(side, known, reached))
                    found.insert(found.end(), reached.begin(), reached.end());
                known.insert(reached.begin(), reached.end());
            });
        }
        return found;
    }

    /// Whether the voxels connected to @a from are a cavity; @a reached holds some or all of them.
    /// @param known  voxels outside all cavities still to be found.
    bool isCavity(const Coord& from, const Voxels& known, std::vector<Coord>& reached) const
    {
        Voxels seen{from};
        reached = {from};
        for (std::size_t n = 0; n < reached.size(); ++n) {
            if (n % kCheckStride == 0) mProgress.check();
            if (reached.size() > mFill.ball || !mFill.isBetween(reached[n])) return false;
            bool isOpen = false;
            forEachFaceNeighbor(Coord(reached[n]), [&](const Coord& side) {
                if (isFilledSide(side) || !seen.insert(side).second) return;
                isOpen |= known.count(side) > 0;
                reached.push_back(side);
            });
            if (isOpen) return false;
        }
        return true;
    }

    openvdb::tree::ValueAccessor<FloatTree> mAccess;
    Fill mFill;
    Interrupter& mProgress;
    bool mSide = false; ///< whether the filled voxels are below zero
};

} // namespace

std::vector<Coord> fillCavities(FloatTree& tree, Fill fill, Interrupter& progress)
{
    if (fill.voxels.empty()) return {};
    return CavityFiller(tree, std::move(fill), progress).fill();
}

} // namespace mpuvdb
