// What points give to the nodes of a lattice, and what places see in them.
#pragma once
#include "moment_tree.h"

#include <array>
#include <cstdint>
#include <vector>

namespace mpuvdb
{

/// The number below, of a number that an int holds.
inline int floorOf(float x)
{
    const int cut = int(x);
    return cut - int(float(cut) > x);
}

/// The nodes of a lattice that places lie between, and what points give to them.
class LatticeWindow
{
public:
    /// Where a place is among the nodes.
    struct Spot {
        std::int32_t offset; ///< of the first of the eight about it
        float x, y, z;       ///< from that one, in steps
    };
    /// 1, and the normal of a place.
    using Tilt = std::array<float, 4>;

    /// None yet, of those about the places in @a box.
    /// @param reach  how far points give to nodes. @param fine  steps between nodes in it: 1 or 2.
    void open(const Eigen::AlignedBox3f& box, float reach, int fine, std::size_t length)
    {
        mFine = fine;
        mStep = reach / float(fine);
        mPerStep = 1 / mStep;
        mLength = length;
        const int margin = 2 * fine - 1; // nodes that points give to beside those that are wanted
        for (int k = 0; k < 3; ++k) {
            mFirst[k] = floorOf(mPerStep * box.min()[k]) - margin;
            mSize[k] = floorOf(mPerStep * box.max()[k]) + 2 + margin - mFirst[k];
        }
        mSlots.assign(mSize.cast<std::size_t>().prod(), 0);
        mIsWanted.assign(mSlots.size(), 0);
        mUsed = std::int32_t(mLength); // the first is of what is not wanted
    }
    static double nodesOf(const Eigen::AlignedBox3f& box, float step)
    {
        return ((box.sizes() / step).array() + 8).cast<double>().prod();
    }
    /// Have the nodes about @a p.
    Spot request(const Vec3f& p)
    {
        const Vec3f at = mPerStep * p;
        const Spot spot = spotOf({floorOf(at[0]), floorOf(at[1]), floorOf(at[2])}, at);
        if (mIsWanted[std::size_t(spot.offset)]) return spot;
        mIsWanted[std::size_t(spot.offset)] = 1;
        const auto across = std::size_t(mSize[2]), slab = std::size_t(mSize[1]) * across;
        for (const std::size_t row : {std::size_t(0), across, slab, slab + across})
            for (const std::size_t side : {0, 1}) {
                std::int32_t& slot = mSlots[std::size_t(spot.offset) + row + side];
                if (slot) continue;
                slot = mUsed;
                mUsed += std::int32_t(mLength);
            }
        return spot;
    }
    /// All that are wanted are.
    void clear()
    {
        mSums.assign(std::size_t(mUsed), 0);
        mPoints.clear();
    }
    /// Where points reach nodes.
    Eigen::AlignedBox3f reach() const
    {
        const auto edge = [this](const Vec3i& node) { return Vec3f(mStep * node.cast<float>()); };
        return {edge(mFirst.array() + (mFine - 1)), edge((mFirst + mSize).array() - mFine)};
    }
    /// Room for what a point at @a p gives.
    float* add(const Vec3f& p)
    {
        if (mPoints.size() == kBatchPoints) scatter();
        if (mGiven.size() < kBatchPoints * mLength) mGiven.resize(kBatchPoints * mLength);
        float* const room = mGiven.data() + mPoints.size() * mLength;
        const Vec3f at = mPerStep * p;
        const Vec3i cell(floorOf(at[0]), floorOf(at[1]), floorOf(at[2]));
        const Vec3i first = cell.array() - (mFine - 1);
        const bool inside = (first.array() >= mFirst.array()).all() &&
                            ((first - mFirst).array() + 2 * mFine <= mSize.array()).all();
        if (inside) {
            mPoints.push_back(spotOf(cell, at));
            mPoints.back().offset = spotOf(first, at).offset;
        }
        return room;
    }
    void flush() { scatter(); }
    /// What each of @a spots sees, one number for each quantity of the sums. Points of opposite
    /// normals weigh @a opposedWeight.
    void read(const std::vector<Spot>& spots, const std::vector<Tilt>& tilts, float opposedWeight,
              std::vector<float>& means) const;

private:
    static constexpr std::size_t kBatchPoints = 256; ///< points; changes times alone

    Spot spotOf(const Vec3i& cell, const Vec3f& at) const
    {
        const Vec3i node = cell - mFirst;
        return {(node[0] * mSize[1] + node[1]) * mSize[2] + node[2], at[0] - float(cell[0]),
                at[1] - float(cell[1]), at[2] - float(cell[2])};
    }
    void scatter();

    int mFine = 1;
    float mStep = 1, mPerStep = 1;
    std::size_t mLength = 0;
    Vec3i mFirst, mSize;
    std::vector<std::int32_t> mSlots;    ///< of the nodes, where in mSums; 0: not wanted
    std::vector<std::uint8_t> mIsWanted; ///< by the first of eight nodes: all of them are
    std::int32_t mUsed = 0;              ///< of mSums
    std::vector<float> mSums;
    std::vector<Spot> mPoints;
    std::vector<float> mGiven; ///< what they give
};

} // namespace mpuvdb
