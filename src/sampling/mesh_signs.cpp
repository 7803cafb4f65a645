#include "mesh_signs.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <array>
#include <cmath>
#include <fmt/format.h>
#include <tbb/parallel_for.h>
#include <unordered_map>

namespace mpuvdb
{
namespace
{

using Tree = openvdb::FloatTree;
using Leaf = Tree::LeafNodeType;
using LeafManager = openvdb::tree::LeafManager<Tree>;

/// Voxels that two neighbors can be from a surface together that passes between them, and from the
/// rim of a hole as wide as a voxel. [derived: the first is the length of the edge between them; a
/// hole's rim is half a voxel from where the edge passes through it, as seen from either end]
constexpr double kAcross = 1, kThroughHole = 2;
constexpr double kRoundings = 1 + 1e-4; // of the distances

/// A voxel of the band, and the next one along an axis, of which only one is inside though they are
/// farther from the surface than neighbors of two sides are.
struct Dispute {
    std::size_t leaf;
    openvdb::Coord voxel;
    int axis;
    double apart; ///< voxels: their distances together
};

/// Finds disputes, and has them settled by winding numbers.
class Settlement
{
public:
    Settlement(Tree& tree, const PlacedTriangles& triangles, const SolidBoundary& solid)
        : mBand(tree), mTriangles(triangles), mSolid(solid), mAsked(mBand.leafCount())
    {
        for (std::size_t n = 0; n < mBand.leafCount(); ++n) mNumbers[mBand.leaf(n).origin()] = n;
    }

    void run(Interrupter& progress)
    {
        std::vector<Dispute> disputes = find();
        while (askAbout(disputes, progress)) disputes = find();
        demandNoHole(disputes);
    }

private:
    std::vector<Dispute> find() const
    {
        std::vector<std::vector<Dispute>> found(mBand.leafCount());
        tbb::parallel_for(std::size_t(0), mBand.leafCount(),
                          [&](std::size_t n) { look(n, found[n]); });
        std::vector<Dispute> all;
        for (const auto& some : found) all.insert(all.end(), some.begin(), some.end());
        return all;
    }

    void look(std::size_t n, std::vector<Dispute>& found) const
    {
        const Leaf& leaf = mBand.leaf(n);
        std::array<const Leaf*, 3> beside;
        for (int axis = 0; axis < 3; ++axis) {
            openvdb::Coord origin = leaf.origin();
            origin[axis] += kDim;
            const auto at = mNumbers.find(origin);
            beside[std::size_t(axis)] = at != mNumbers.end() ? &mBand.leaf(at->second) : nullptr;
        }
        for (auto on = leaf.cbeginValueOn(); on; ++on) {
            const openvdb::Coord at = on.getCoord();
            for (int axis = 0; axis < 3; ++axis) {
                openvdb::Coord next = at;
                ++next[axis];
                const bool isHere = next[axis] & (kDim - 1);
                const Leaf* const other = isHere ? &leaf : beside[std::size_t(axis)];
                float there = 0;
                if (!other || !other->probeValue(next, there) || (*on < 0) == (there < 0)) continue;
                const double apart = double(std::abs(*on) + std::abs(there)) / mTriangles.voxelSize;
                if (apart > kAcross * kRoundings) found.push_back({n, at, axis, apart});
            }
        }
    }

    /// Give the voxels of disputes the signs that winding numbers tell, each once. @return whether
    /// there were any that had not been asked about.
    bool askAbout(const std::vector<Dispute>& disputes, Interrupter& progress)
    {
        std::vector<openvdb::Coord> voxels;
        for (const Dispute& d : disputes)
            for (const int step : {0, 1}) {
                openvdb::Coord voxel = d.voxel;
                voxel[d.axis] += step;
                auto& asked = mAsked[mNumbers.at(voxel & ~(kDim - 1))];
                const auto offset = Leaf::coordToOffset(voxel);
                if (asked.isOn(offset)) continue;
                asked.setOn(offset);
                voxels.push_back(voxel);
            }
        std::vector<std::uint8_t> inside(voxels.size());
        tbb::parallel_for(std::size_t(0), voxels.size(), [&](std::size_t n) {
            if (n % 64 == 0) progress.check();
            inside[n] = mSolid.isInside(
                mTriangles.place(Vec3d(voxels[n].x(), voxels[n].y(), voxels[n].z())));
        });
        for (std::size_t n = 0; n < voxels.size(); ++n) {
            Leaf& leaf = mBand.leaf(mNumbers.at(voxels[n] & ~(kDim - 1)));
            const float distance = std::abs(leaf.getValue(voxels[n]));
            leaf.setValueOnly(voxels[n], inside[n] ? -distance : distance);
        }
        return !voxels.empty();
    }

    void demandNoHole(const std::vector<Dispute>& disputes) const
    {
        const Dispute* widest = nullptr;
        for (const Dispute& d : disputes)
            if (d.apart > kThroughHole * kRoundings && (!widest || d.apart > widest->apart))
                widest = &d;
        if (!widest) return;
        const openvdb::Coord& v = widest->voxel;
        const Vec3d at = mTriangles.place(Vec3d(v.x(), v.y(), v.z())) + mTriangles.frame;
        throw InputError(fmt::format(
            "mesh: is open: near ({:.6g}, {:.6g}, {:.6g}) a hole wider than a voxel leads inside "
            "({} of its edges bound holes). Close its holes, use larger voxels, or reconstruct a "
            "surface from its points",
            at[0], at[1], at[2], mSolid.report().openEdges));
    }

    static constexpr int kDim = Leaf::DIM;
    LeafManager mBand;
    const PlacedTriangles& mTriangles;
    const SolidBoundary& mSolid;
    std::unordered_map<openvdb::Coord, std::size_t> mNumbers; ///< of leaves, by origin
    std::vector<Leaf::NodeMaskType> mAsked;                   ///< of each leaf, voxels
};

} // namespace

void settleSigns(Tree& tree, const PlacedTriangles& triangles, const SolidBoundary& solid,
                 Interrupter& progress)
{
    Settlement(tree, triangles, solid).run(progress);
}

} // namespace mpuvdb
