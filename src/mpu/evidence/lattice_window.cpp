#include "lattice_window.h"

#include "core/clones.h"
#include "core/lanes.h"

#include <array>

namespace mpuvdb
{
namespace
{

constexpr std::size_t kLanes =
    MomentTree::kLanes; ///< lanes of a vector [derived: those of the sums]
using Lanes = float __attribute__((vector_size(4 * kLanes)));

/// The weights of the eight nodes about a place.
[[gnu::always_inline]] inline std::array<float, 8> weightsAt(const LatticeWindow::Spot& p)
{
    const float xy = p.x * p.y;
    const float pairs[4] = {1 - p.x - p.y + xy, p.y - xy, p.x - xy, xy};
    std::array<float, 8> weights;
    for (std::size_t k = 0; k < 4; ++k) {
        weights[2 * k + 1] = pairs[k] * p.z;
        weights[2 * k] = pairs[k] - weights[2 * k + 1];
    }
    return weights;
}

/// The slots of the eight nodes about a place.
[[gnu::always_inline]] inline std::array<std::int32_t, 8>
slotsAt(const std::int32_t* at, std::ptrdiff_t slab, std::ptrdiff_t row)
{
    return {at[0],    at[1],        at[row],        at[row + 1],
            at[slab], at[slab + 1], at[slab + row], at[slab + row + 1]};
}

/// Add the sums of points to the nodes less than @a fine steps away, by linear weights.
/// @param points  in the cell in the middle of those nodes; the first node's offset.
[[gnu::always_inline]] inline void scatterBy(const std::vector<LatticeWindow::Spot>& points,
                                             const float* given, int fine,
                                             const std::int32_t* slots, std::ptrdiff_t slab,
                                             std::ptrdiff_t row, std::size_t length, float* sums)
{
    for (const LatticeWindow::Spot& p : points) {
        float weights[3][4];
        for (int n = 0; n < 2 * fine; ++n) {
            const float fall = 1 / float(fine), from = float(n + 1 - fine);
            const auto weight = [&](float t) {
                const float apart = t > from ? t - from : from - t;
                return 1 - fall * apart;
            };
            weights[0][n] = weight(p.x);
            weights[1][n] = weight(p.y);
            weights[2][n] = weight(p.z);
        }
        for (int i = 0; i < 2 * fine; ++i)
            for (int j = 0; j < 2 * fine; ++j) {
                const std::int32_t* const slot = slots + p.offset + i * slab + j * row;
                const float across = weights[0][i] * weights[1][j];
                for (int k = 0; k < 2 * fine; ++k) {
                    if (!slot[k]) continue; // not requested
                    const float weight = across * weights[2][k];
                    float* const into = sums + slot[k];
                    for (std::size_t n = 0; n < length; n += kLanes) {
                        const Lanes sum =
                            lanesAt<Lanes>(into + n) + weight * lanesAt<Lanes>(given + n);
                        std::memcpy(into + n, &sum, sizeof sum);
                    }
                }
            }
        given += length;
    }
}

MPUVDB_WIDE_CLONES
void scatterTo(const std::vector<LatticeWindow::Spot>& points, const float* given, int fine,
               const std::int32_t* slots, std::ptrdiff_t slab, std::ptrdiff_t row,
               std::size_t length, float* sums)
{
    if (fine == 1 && length == kLanes) // the most frequent, with loops of known lengths
        scatterBy(points, given, 1, slots, slab, row, kLanes, sums);
    else
        scatterBy(points, given, fine, slots, slab, row, length, sums);
}

/// Trilinear means of the sums of the eight nodes about places, weighted by the normals' sides.
[[gnu::always_inline]] inline void collectBy(const std::vector<LatticeWindow::Spot>& spots,
                                             const Quad* tilts, const std::uint32_t* place,
                                             float opposedWeight, const std::int32_t* slots,
                                             std::ptrdiff_t slab, std::ptrdiff_t row,
                                             std::size_t length, const float* sums, float* means)
{
    const float along = 0.5f * (1 + opposedWeight), across = 0.5f * (1 - opposedWeight);
    for (const LatticeWindow::Spot& p : spots) {
        const std::array<float, 8> weights = weightsAt(p);
        const std::array<std::int32_t, 8> nodes = slotsAt(slots + p.offset, slab, row);
        const auto tilt = Quad::Lanes{along, across, across, across} * tilts[*place++].lanes;
        for (std::size_t n = 0; n < length; n += kLanes) {
            Lanes sum{};
            for (std::size_t k = 0; k < 8; ++k)
                sum += weights[k] * lanesAt<Lanes>(sums + nodes[k] + n);
            const auto tilted = tilt[0] * __builtin_shufflevector(sum, sum, 0, 1, 2, 3) +
                                tilt[1] * __builtin_shufflevector(sum, sum, 4, 5, 6, 7) +
                                tilt[2] * __builtin_shufflevector(sum, sum, 8, 9, 10, 11) +
                                tilt[3] * __builtin_shufflevector(sum, sum, 12, 13, 14, 15);
            std::memcpy(means, &tilted, sizeof tilted);
            means += kLanes / 4;
        }
    }
}

MPUVDB_WIDE_CLONES
void collectFrom(const std::vector<LatticeWindow::Spot>& spots, const Quad* tilts,
                 const std::uint32_t* place, float opposedWeight, const std::int32_t* slots,
                 std::ptrdiff_t slab, std::ptrdiff_t row, std::size_t length, const float* sums,
                 float* means)
{
    if (length == kLanes)
        collectBy(spots, tilts, place, opposedWeight, slots, slab, row, kLanes, sums, means);
    else
        collectBy(spots, tilts, place, opposedWeight, slots, slab, row, length, sums, means);
}

} // namespace

void LatticeWindow::request(const std::vector<Quad>& positions,
                            const std::vector<std::uint32_t>& places, std::vector<Spot>& spots)
{
    spots.resize(places.size());
    mWanted.resize(places.size());
    std::size_t wanted = 0;
    // Without branches: none could be predicted.
    for (std::size_t n = 0; n < places.size(); ++n) {
        const Quad::Lanes at = mPerStep * positions[places[n]].lanes, cell = floorOf(at);
        spots[n] = spotOf(at - cell, cell - mOrigin);
        std::uint8_t& isWanted = mIsWanted[std::size_t(spots[n].offset)];
        mWanted[wanted] = spots[n].offset;
        wanted += std::size_t(!isWanted);
        isWanted = 1;
    }
    mWanted.resize(wanted);
    for (const std::int32_t first : mWanted)
        forEachAbout(first, [this](std::size_t node) {
            std::int32_t& slot = mSlots[node];
            const bool isNew = !slot;
            slot = isNew ? mUsed : slot;
            mUsed += isNew ? std::int32_t(mLength) : 0;
        });
    mSums.resize(std::size_t(mUsed));
    std::memset(mSums.data(), 0, mSums.size() * sizeof(float)); // assign() fills them one by one
    mPoints.clear();
}

void LatticeWindow::scatter()
{
    scatterTo(mPoints, mGiven.data(), mFine, mSlots.data(), mSize[1] * mSize[2], mSize[2], mLength,
              mSums.data());
    mPoints.clear();
}

void LatticeWindow::read(const std::vector<Spot>& spots, const std::vector<Quad>& tilts,
                         const std::vector<std::uint32_t>& places, float opposedWeight,
                         std::vector<float>& means) const
{
    means.resize(spots.size() * mLength / 4);
    collectFrom(spots, tilts.data(), places.data(), opposedWeight, mSlots.data(),
                mSize[1] * mSize[2], mSize[2], mLength, mSums.data(), means.data());
}

} // namespace mpuvdb
