// Sums of points at the nodes of a lattice, and their means at places.
#pragma once
#include "moment_tree.h"

#include <cmath>
#include <cstdint>
#include <cstring>
#include <vector>

namespace mpuvdb
{

/// Four numbers of a register: a position and 0, or 1 and a normal.
struct alignas(16) Quad {
    using Lanes = float __attribute__((vector_size(16)));
    Lanes lanes{};

    Vec3f head() const { return {lanes[0], lanes[1], lanes[2]}; }
};

/// The nodes of a lattice around places, and the sums of points there.
class LatticeWindow
{
public:
    /// Position of a place among the nodes.
    struct alignas(16) Spot {
        float x, y, z;       ///< from the first of the eight nodes about it, in steps
        std::int32_t offset; ///< index of that node
    };

    /// Start a window around the places in @a box, without nodes.
    /// @param reach  distance up to which points add to nodes. @param fine  nodes in it: 1 or 2.
    /// @param length  numbers of a node's sums.
    void open(const Eigen::AlignedBox3f& box, float reach, int fine, std::size_t length)
    {
        forget();
        mFine = fine;
        mStep = reach / float(fine);
        mPerStep = 1 / mStep;
        mLength = length;
        const int margin = 2 * fine - 1; // nodes that points add to beside those requested
        for (int k = 0; k < 3; ++k) {
            mFirst[k] = int(std::floor(mPerStep * box.min()[k])) - margin;
            mSize[k] = int(std::floor(mPerStep * box.max()[k])) + 2 + margin - mFirst[k];
        }
        mOrigin = Quad::Lanes{float(mFirst[0]), float(mFirst[1]), float(mFirst[2]), 0};
        mStrides = Quad::Lanes{float(mSize[1] * mSize[2]), float(mSize[2]), 1, 0};
        mGiven.resize(kBatchPoints * mLength);
        const auto nodes = mSize.cast<std::size_t>().prod();
        if (mSlots.size() < nodes) {
            mSlots.resize(nodes, 0);
            mIsWanted.resize(nodes, 0);
        }
        mUsed = std::int32_t(mLength); // the first sums are of nodes that are not requested
    }
    /// Number of nodes around @a box, at most.
    static double nodesOf(const Eigen::AlignedBox3f& box, float step)
    {
        return ((box.sizes() / step).array() + 8).cast<double>().prod();
    }
    /// Request the nodes about @a places, given as indices of @a positions, and clear all sums.
    /// @param spots  set to those of the places.
    void request(const std::vector<Quad>& positions, const std::vector<std::uint32_t>& places,
                 std::vector<Spot>& spots);
    /// The box in which points reach nodes.
    Eigen::AlignedBox3f reach() const
    {
        const auto edge = [this](const Vec3i& node) { return Vec3f(mStep * node.cast<float>()); };
        return {edge(mFirst.array() + (mFine - 1)), edge((mFirst + mSize).array() - mFine)};
    }
    /// The memory for the sums of a point at @a p, to be set by the caller; null for one that
    /// reaches no node.
    float* add(const Vec3f& p)
    {
        const Quad::Lanes at = mPerStep * Quad::Lanes{p[0], p[1], p[2], 0}, cell = floorOf(at),
                          first = cell - mOrigin - float(mFine - 1);
        for (int k = 0; k < 3; ++k)
            if (first[k] < 0 || first[k] + float(2 * mFine) > float(mSize[k])) return nullptr;
        if (mPoints.size() == kBatchPoints) scatter();
        mPoints.push_back(spotOf(at - cell, first));
        return mGiven.data() + (mPoints.size() - 1) * mLength;
    }
    /// Add the last points.
    void flush() { scatter(); }
    /// Set @a means to the sums interpolated at @a spots, one number for each quantity. Points of
    /// opposite normals weigh @a opposedWeight.
    /// @param tilts  1 and the normal of each place. @param places  those of the spots.
    void read(const std::vector<Spot>& spots, const std::vector<Quad>& tilts,
              const std::vector<std::uint32_t>& places, float opposedWeight,
              std::vector<float>& means) const;

private:
    static constexpr std::size_t kBatchPoints = 256; ///< points added at once [free: time]

    static Quad::Lanes floorOf(const Quad::Lanes& at)
    {
        using Whole = std::int32_t __attribute__((vector_size(16)));
        Whole cut = __builtin_convertvector(at, Whole);
        cut += __builtin_convertvector(cut, Quad::Lanes) > at; // -1 where it was rounded up
        return __builtin_convertvector(cut, Quad::Lanes);
    }
    /// @param apart  from a cell's first node, steps. @param node  from the window's first, in it.
    Spot spotOf(const Quad::Lanes& apart, const Quad::Lanes& node) const
    {
        const Quad::Lanes steps = node * mStrides; // exact: windows are small
        Spot spot;
        std::int32_t __attribute__((vector_size(16))) bits;
        std::memcpy(&bits, &apart, sizeof bits);
        bits[3] = std::int32_t(steps[0] + steps[1] + steps[2]);
        std::memcpy(&spot, &bits, sizeof spot); // at once: reading the whole waits for parts
        return spot;
    }
    /// Call f(node) for the eight nodes about a place by the first of them.
    template <typename F>
    void forEachAbout(std::int32_t first, F f) const
    {
        const std::ptrdiff_t row = mSize[2], slab = mSize[1] * row;
        for (const std::ptrdiff_t above : {std::ptrdiff_t(0), row, slab, slab + row})
            for (const std::ptrdiff_t side : {0, 1}) f(std::size_t(first + above + side));
    }
    /// Take back what was requested: few nodes of a window are.
    void forget()
    {
        for (const std::int32_t first : mWanted) {
            mIsWanted[std::size_t(first)] = 0;
            forEachAbout(first, [this](std::size_t node) { mSlots[node] = 0; });
        }
        mWanted.clear();
    }
    void scatter();

    int mFine = 1;
    float mStep = 1, mPerStep = 1;
    std::size_t mLength = 0;
    Vec3i mFirst, mSize;
    Quad::Lanes mOrigin, mStrides; ///< mFirst; from a node to the next one, in mSlots
    /// Of the nodes, their indices in mSums; 0: none. All beyond a window's nodes are 0, too.
    std::vector<std::int32_t> mSlots;
    std::vector<std::uint8_t> mIsWanted; ///< by the first of eight nodes: all are requested
    std::vector<std::int32_t> mWanted;   ///< those first nodes
    std::int32_t mUsed = 0;              ///< size of mSums
    std::vector<float> mSums;
    std::vector<Spot> mPoints;
    std::vector<float> mGiven; ///< their sums
};

} // namespace mpuvdb
