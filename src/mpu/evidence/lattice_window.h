// Sums of points at the nodes of a lattice, and their means at places.
#pragma once
#include "moment_tree.h"

#include <array>
#include <cstdint>
#include <vector>

namespace mpuvdb
{

/// The floor of a number in the range of int.
inline int floorOf(float x)
{
    const int cut = int(x);
    return cut - int(float(cut) > x);
}

/// The nodes of a lattice around places, and the sums of points there.
class LatticeWindow
{
public:
    /// Position of a place among the nodes.
    struct Spot {
        std::int32_t offset; ///< index of the first of the eight nodes about it
        float x, y, z;       ///< from that node, in steps
    };
    /// 1, and the normal of a place.
    using Tilt = std::array<float, 4>;

    /// Start a window around the places in @a box, without nodes.
    /// @param reach  distance up to which points add to nodes. @param fine  nodes in it: 1 or 2.
    /// @param length  numbers of a node's sums.
    void open(const Eigen::AlignedBox3f& box, float reach, int fine, std::size_t length)
    {
        mFine = fine;
        mStep = reach / float(fine);
        mPerStep = 1 / mStep;
        mLength = length;
        const int margin = 2 * fine - 1; // nodes that points add to beside those requested
        for (int k = 0; k < 3; ++k) {
            mFirst[k] = floorOf(mPerStep * box.min()[k]) - margin;
            mSize[k] = floorOf(mPerStep * box.max()[k]) + 2 + margin - mFirst[k];
        }
        mSlots.assign(mSize.cast<std::size_t>().prod(), 0);
        mIsWanted.assign(mSlots.size(), 0);
        mUsed = std::int32_t(mLength); // the first sums are of nodes that are not requested
    }
    /// Number of nodes around @a box, at most.
    static double nodesOf(const Eigen::AlignedBox3f& box, float step)
    {
        return ((box.sizes() / step).array() + 8).cast<double>().prod();
    }
    /// Request the nodes about @a p.
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
    /// Clear the sums, after all requests.
    void clear()
    {
        mSums.assign(std::size_t(mUsed), 0);
        mPoints.clear();
    }
    /// The box in which points reach nodes.
    Eigen::AlignedBox3f reach() const
    {
        const auto edge = [this](const Vec3i& node) { return Vec3f(mStep * node.cast<float>()); };
        return {edge(mFirst.array() + (mFine - 1)), edge((mFirst + mSize).array() - mFine)};
    }
    /// The memory for the sums of a point at @a p, to be set by the caller.
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
    /// Add the last points.
    void flush() { scatter(); }
    /// Set @a means to the sums interpolated at @a spots, one number for each quantity. Points of
    /// opposite normals weigh @a opposedWeight.
    void read(const std::vector<Spot>& spots, const std::vector<Tilt>& tilts, float opposedWeight,
              std::vector<float>& means) const;

private:
    static constexpr std::size_t kBatchPoints = 256; ///< points added at once [free: time]

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
    std::vector<std::int32_t> mSlots;    ///< of the nodes, their indices in mSums; 0: none
    std::vector<std::uint8_t> mIsWanted; ///< by the first of eight nodes: all are requested
    std::int32_t mUsed = 0;              ///< size of mSums
    std::vector<float> mSums;
    std::vector<Spot> mPoints;
    std::vector<float> mGiven; ///< their sums
};

} // namespace mpuvdb
