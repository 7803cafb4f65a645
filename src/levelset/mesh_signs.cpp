#include "mesh_signs.h"

#include <mpuvdb/point_triangle.h>
#include <mpuvdb/union_find.h>

#include <tbb/parallel_for.h>

#include <array>
#include <atomic>
#include <cmath>
#include <unordered_map>

namespace mpuvdb
{
namespace
{

using Tree = openvdb::FloatTree;
using LeafManager = openvdb::tree::LeafManager<Tree>;

/// Gives the voxels of @a band the signs that those of @a signs have.
void takeSigns(LeafManager& band, const Tree& signs)
{
    band.foreach ([&](Tree::LeafNodeType& leaf, std::size_t) {
        const openvdb::tree::ValueAccessor<const Tree> at(signs);
        for (auto on = leaf.beginValueOn(); on; ++on)
            if (at.getValue(on.getCoord()) < 0) on.setValue(-*on);
    });
}

/// Signs of voxels that cannot be told apart by the mesh: no triangle passes between neighbours of
/// which the distances, in voxels, are more than one together.
class SignVote
{
public:
    SignVote(LeafManager& band, double voxelSize)
        : mBand(band), mFarthest(float(kRoundings * voxelSize))
    {
        for (std::size_t n = 0; n < band.leafCount(); ++n) mNumbers[band.leaf(n).origin()] = n;
    }

    /// Whether neighbours differ that cannot.
    bool isDisputed() const
    {
        std::atomic<bool> found{false};
        tbb::parallel_for(tbb::blocked_range<std::size_t>(0, mBand.leafCount()),
                          [&](const tbb::blocked_range<std::size_t>& range) {
                              for (std::size_t n = range.begin(); n < range.end() && !found; ++n)
                                  forEachPair(n, [&](float a, float b, std::size_t, std::size_t) {
                                      if ((a < 0) != (b < 0)) found = true;
                                  });
                          });
        return found;
    }

    /// Gives every set of such voxels the sign that nearly all of them have. Where they do not
    /// agree, the mesh has a hole, and they keep theirs.
    void settle()
    {
        constexpr std::size_t kAgree = 8; // so many times as many as the others
        UnionFind sets(mBand.leafCount() * kVoxels);
        for (std::size_t n = 0; n < mBand.leafCount(); ++n)
            forEachPair(n, [&](float, float, std::size_t i, std::size_t j) {
                sets.join(std::uint32_t(i), std::uint32_t(j));
            });
        std::unordered_map<std::uint32_t, std::array<std::size_t, 2>> votes; // outside, inside
        const auto forEachVoxel = [&](const auto& visit) {
            for (std::size_t n = 0; n < mBand.leafCount(); ++n)
                for (auto on = mBand.leaf(n).beginValueOn(); on; ++on)
                    visit(on, sets.find(std::uint32_t(n * kVoxels + on.pos())));
        };
        forEachVoxel([&](const auto& on, std::uint32_t set) { ++votes[set][*on < 0]; });
        forEachVoxel([&](const auto& on, std::uint32_t set) {
            const auto& [outside, inside] = votes[set];
            if (inside > kAgree * outside) on.setValue(-std::abs(*on));
            if (outside > kAgree * inside) on.setValue(std::abs(*on));
        });
    }

private:
    static constexpr std::size_t kVoxels = Tree::LeafNodeType::SIZE;

    /// Calls f(value, value of the next, number, number of the next) for all pairs of a voxel of
    /// leaf @a n and the next one along an axis between which nothing passes.
    template <typename F>
    void forEachPair(std::size_t n, const F& f) const
    {
        const Tree::LeafNodeType& leaf = mBand.leaf(n);
        std::array<std::size_t, 3> beside;
        for (int axis = 0; axis < 3; ++axis) {
            openvdb::Coord origin = leaf.origin();
            origin[axis] += kDim;
            const auto found = mNumbers.find(origin);
            beside[std::size_t(axis)] = found != mNumbers.end() ? found->second : kNoLeaf;
        }
        for (auto on = leaf.cbeginValueOn(); on; ++on) {
            const openvdb::Coord at = on.getCoord();
            for (std::size_t axis = 0; axis < 3; ++axis) {
                openvdb::Coord next = at;
                ++next[int(axis)];
                const bool isHere = next[int(axis)] & (kDim - 1);
                const std::size_t m = isHere ? n : beside[axis];
                if (m == kNoLeaf) continue;
                const auto offset = Tree::LeafNodeType::coordToOffset(next);
                const Tree::LeafNodeType& other = mBand.leaf(m);
                const float there = other.getValue(offset);
                if (other.isValueOn(offset) && std::abs(*on) + std::abs(there) > mFarthest)
                    f(*on, there, n * kVoxels + on.pos(), m * kVoxels + offset);
            }
        }
    }

    static constexpr int kDim = Tree::LeafNodeType::DIM;
    static constexpr std::size_t kNoLeaf = ~std::size_t(0);
    LeafManager& mBand;
    static constexpr double kRoundings = 1 + 1e-4; // of the distances
    float mFarthest; ///< that neighbours of two sides can be from the mesh together
    std::unordered_map<openvdb::Coord, std::size_t> mNumbers; ///< of leaves, by origin
};

/// Signs of voxels so near to the mesh that their neighbours do not tell: by the triangle that they
/// see most squarely among those nearest to them.
class FacingSigns
{
public:
    FacingSigns(LeafManager& band, const PlacedTriangles& triangles)
        : mBand(band), mTriangles(triangles), mFlips(band.leafCount())
    {
        tbb::parallel_for(std::size_t(0), band.leafCount(), [&](std::size_t n) { look(n); });
    }

    /// Flips those that face the other way, if the mesh's triangles as a rule face outwards, or as
    /// a rule inwards.
    void settle()
    {
        constexpr std::size_t kRule = 8; // so many times as many as the others
        const std::size_t right = mRight, wrong = mWrong;
        const bool outwards = right > kRule * wrong, inwards = wrong > kRule * right;
        if (!outwards && !inwards) return;
        mBand.foreach ([&](Tree::LeafNodeType& leaf, std::size_t n) {
            for (const Seen& seen : mFlips[n])
                if (seen.isWrong == outwards)
                    leaf.setValueOnly(seen.voxel, -leaf.getValue(seen.voxel));
        });
    }

private:
    struct Seen {
        openvdb::Index voxel;
        bool isWrong; ///< if triangles face outwards
    };

    void look(std::size_t n)
    {
        constexpr double kNear = 0.25; // voxels: others are sure
        const openvdb::tree::ValueAccessor<const Tree> at(mBand.tree());
        for (auto on = mBand.leaf(n).cbeginValueOn(); on; ++on) {
            const double distance = std::abs(double(*on));
            if (distance >= kNear * mTriangles.voxelSize || !isBetween(at, on.getCoord())) continue;
            const openvdb::Coord voxel = on.getCoord();
            const double side = sideOf(Vec3d(voxel.x(), voxel.y(), voxel.z()), distance);
            if (side == 0) continue;
            const bool isWrong = (side < 0) != (*on < 0);
            ++(isWrong ? mWrong : mRight);
            mFlips[n].push_back({on.pos(), isWrong});
        }
    }

    /// Whether it has neighbours of both sides: beside faces within the solid it has not.
    static bool isBetween(const openvdb::tree::ValueAccessor<const Tree>& at,
                          const openvdb::Coord& voxel)
    {
        bool inside = false, outside = false;
        for (int axis = 0; axis < 3; ++axis)
            for (const int step : {-1, 1}) {
                openvdb::Coord next = voxel;
                next[axis] += step;
                (at.getValue(next) < 0 ? inside : outside) = true;
            }
        return inside && outside;
    }

    /// Below 0 behind the triangle, 0 if that cannot be told. @param distance  to the mesh.
    double sideOf(const Vec3d& voxel, double distance) const
    {
        constexpr double kRounding = 1e-6; // voxels
        const Vec3d p = mTriangles.place(voxel);
        const double farthest = distance + kRounding * mTriangles.voxelSize;
        double side = 0;
        mTriangles.tree.forEachNear(p, farthest, [&](std::size_t slot) {
            const TriangleTree::Corners& t = mTriangles.tree.corners(slot);
            const Vec3d a = t[0].cast<double>(), b = t[1].cast<double>(), c = t[2].cast<double>();
            if (squaredDistance<double>(p, {a, b, c}) > farthest * farthest) return;
            const double height = (b - a).cross(c - a).normalized().dot(p - a);
            if (std::abs(height) > std::abs(side)) side = height;
        });
        return side;
    }

    LeafManager& mBand;
    const PlacedTriangles& mTriangles;
    std::vector<std::vector<Seen>> mFlips; ///< of each leaf
    std::atomic<std::size_t> mRight{0}, mWrong{0};
};

} // namespace

void signDistances(Tree& tree, const Tree& guess, const PlacedTriangles& triangles)
{
    LeafManager band(tree);
    takeSigns(band, guess);
    SignVote vote(band, triangles.voxelSize);
    if (vote.isDisputed()) vote.settle();
    FacingSigns(band, triangles).settle();
}

} // namespace mpuvdb
