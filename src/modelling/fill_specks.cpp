#include "fill_specks.h"

#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <unordered_set>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using openvdb::FloatTree;

constexpr std::size_t kOften = 1 << 12;

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

class FillMender
{
public:
    FillMender(FloatTree& tree, Fill&& fill, Interrupter& progress)
        : mAccess(tree), mFill(std::move(fill)), mProgress(progress)
    {
        std::sort(mFill.voxels.begin(), mFill.voxels.end());
        mSide = mAccess.getValue(mFill.voxels.front()) < 0;
    }

    std::vector<Coord> mend()
    {
        std::vector<Coord> wrong = loose();
        const std::vector<Coord> closed = pockets();
        wrong.insert(wrong.end(), closed.begin(), closed.end());
        for (const Coord& at : wrong) mAccess.setValueOn(at, -mAccess.getValue(at));
        return wrong;
    }

private:
    static constexpr std::size_t kNone = ~std::size_t(0);

    /// The place of a voxel among the filled.
    std::size_t find(const Coord& at) const
    {
        const auto place = std::lower_bound(mFill.voxels.begin(), mFill.voxels.end(), at);
        return place != mFill.voxels.end() && *place == at
                   ? std::size_t(place - mFill.voxels.begin())
                   : kNone;
    }
    bool isFilledSide(const Coord& at) const { return (mAccess.getValue(at) < 0) == mSide; }

    /// Filled voxels that do not hang together with the solids.
    std::vector<Coord> loose()
    {
        const auto& filled = mFill.voxels;
        std::vector<char> hangs(filled.size(), false);
        std::vector<std::size_t> stack;
        for (std::size_t n = 0; n < filled.size(); ++n) {
            if (n % kOften == 0) mProgress.check();
            forEachFaceNeighbor(filled[n], [&](const Coord& side) {
                if (hangs[n] || !isFilledSide(side) || find(side) != kNone) return;
                hangs[n] = true;
                stack.push_back(n);
            });
        }
        for (std::size_t steps = 0; !stack.empty(); ++steps) {
            if (steps % kOften == 0) mProgress.check();
            const Coord at = filled[stack.back()];
            stack.pop_back();
            forEachFaceNeighbor(at, [&](const Coord& side) {
                const std::size_t n = find(side);
                if (n == kNone || hangs[n]) return;
                hangs[n] = true;
                stack.push_back(n);
            });
        }
        std::vector<Coord> found;
        for (std::size_t n = 0; n < filled.size(); ++n)
            if (!hangs[n]) found.push_back(filled[n]);
        return found;
    }

    /// Voxels of what the fill encloses between the solids where the ball does not fit.
    std::vector<Coord> pockets()
    {
        Voxels known;
        std::vector<Coord> found;
        for (std::size_t n = 0; n < mFill.voxels.size(); ++n) {
            if (n % kOften == 0) mProgress.check();
            forEachFaceNeighbor(mFill.voxels[n], [&](const Coord& side) {
                if (isFilledSide(side) || known.count(side)) return;
                std::vector<Coord> reached;
                if (isPocket(side, known, reached))
                    found.insert(found.end(), reached.begin(), reached.end());
                known.insert(reached.begin(), reached.end());
            });
        }
        return found;
    }

    /// Whether all that hangs together with a voxel is a pocket; @a reached: some of it, or all.
    /// @param known  that no pocket not yet found hangs together with.
    bool isPocket(const Coord& from, const Voxels& known, std::vector<Coord>& reached) const
    {
        Voxels seen{from};
        reached = {from};
        for (std::size_t n = 0; n < reached.size(); ++n) {
            if (n % kOften == 0) mProgress.check();
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
    bool mSide = false; ///< whether what is filled is below zero
};

} // namespace

std::vector<Coord> mendFill(FloatTree& tree, Fill fill, Interrupter& progress)
{
    if (fill.voxels.empty()) return {};
    return FillMender(tree, std::move(fill), progress).mend();
}

} // namespace mpuvdb
