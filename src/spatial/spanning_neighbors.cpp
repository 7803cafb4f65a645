#include "spanning_neighbors.h"

#include <Eigen/Dense>

#include <algorithm>

namespace mpuvdb
{
namespace
{

/// Make the first @a few of @a members every g-th of them; the rest have no order.
void spreadFirst(std::vector<std::uint32_t>& members, std::size_t few)
{
    const std::size_t step = (members.size() - 1) / (few - 1);
    for (std::size_t k = 1; k < few; ++k) std::swap(members[k], members[k * step]);
}

} // namespace

bool spansPlane(const Eigen::Matrix3f& squares, double noise)
{
    // Ratio of second moments about the position. Of twelve points at random in a disc one set in
    // 80 is as uneven [derived: drawn]; at a straight rim it is 1, at a right corner 0.22.
    constexpr double kEven = 0.2;
    const float size = squares.trace();
    if (!(size > 0)) return true;
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix3f> axes;
    axes.computeDirect(squares / size, Eigen::EigenvaluesOnly);
    const double share = noise / double(size);
    return axes.eigenvalues()[1] - share > kEven * (axes.eigenvalues()[2] - share);
}

SpanningNeighbors::SpanningNeighbors(const std::vector<Vec3f>& positions, std::size_t fewest,
                                     double noise)
    : mPositions(positions), mTree(positions), mFewest(fewest),
      mMost(std::min(kMostSpanning, positions.size() - 1)), mVariance(noise * noise)
{
}

bool SpanningNeighbors::about(std::size_t i, std::vector<std::uint32_t>& members) const
{
    thread_local std::vector<float> squared;
    for (std::size_t count = mFewest;; count *= 2) {
        members.resize(count + 1);
        squared.resize(count + 1);
        mTree.nearest(mPositions[i], members, squared);
        const bool spans = span(i, members);
        if (spans || 2 * count > mMost) {
            if (!spans)
                members.resize(mFewest + 1);
            else if (count > mFewest)
                spreadFirst(members, mFewest + 1);
            return spans;
        }
    }
}

bool SpanningNeighbors::span(std::size_t i, const std::vector<std::uint32_t>& members) const
{
    const Vec3f middle = mPositions[i];
    Eigen::Matrix3f moments = Eigen::Matrix3f::Zero();
    for (const std::uint32_t m : members) {
        const Vec3f d = mPositions[m] - middle;
        moments += d * d.transpose();
    }
    return spansPlane(moments, mVariance * double(members.size()));
}

} // namespace mpuvdb
