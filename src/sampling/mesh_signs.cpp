#include "mesh_signs.h"

#include <mpuvdb/field.h>
#include <mpuvdb/interrupter.h>

#include <array>
#include <cmath>
#include <tbb/parallel_for.h>
#include <unordered_map>

namespace mpuvdb
{
namespace
{

using Tree = openvdb::FloatTree;
using Leaf = Tree::LeafNodeType;
using LeafManager = openvdb::tree::LeafManager<Tree>;

/// Largest sum of the distances of two neighbors, voxels, from a surface between them, and from the
/// rim of a hole as wide as a voxel. [derived: the first is the length of the edge between them; a
/// hole's rim is half a voxel from where the edge passes through it, as seen from either end]
constexpr double kAcross = 1, kThroughHole = 2;
constexpr double kRoundings = 1 + 1e-4; ///< factor [derived: a thousand roundings of a float]

/// A voxel of the band and the next one along an axis whose signs contradict their distances.
struct Conflict {
    std::size_t leaf;
    openvdb::Coord voxel;
    int axis;
    double apart; ///< sum of their distances, voxels
};

/// Finds conflicts, and resolves them by winding numbers.
class SignRepair
{
public:
    SignRepair(Tree& tree, const PlacedTriangles& triangles, const SolidBoundary& solid)
        : mBand(tree), mTriangles(triangles), mSolid(solid), mResolved(mBand.leafCount())
    {
        for (std::size_t n = 0; n < mBand.leafCount(); ++n) mNumbers[mBand.leaf(n).origin()] = n;
    }

    std::optional<WayThrough> run(Interrupter& progress)
    {
        setSigns(besideSeams(), progress);
        std::vector<Conflict> conflicts = find();
        while (resolve(conflicts, progress)) conflicts = find();
        return widest(conflicts);
    }

private:
    std::vector<Conflict> find() const
    {
        std::vector<std::vector<Conflict>> found(mBand.leafCount());
        tbb::parallel_for(std::size_t(0), mBand.leafCount(),
                          [&](std::size_t n) { look(n, found[n]); });
        std::vector<Conflict> all;
        for (const auto& some : found) all.insert(all.end(), some.begin(), some.end());
        return all;
    }

    void look(std::size_t n, std::vector<Conflict>& found) const
    {
        const Leaf& leaf = mBand.leaf(n);
        std::array<const Leaf*, 3> beside;
        for (int axis = 0; axis < 3; ++axis) {
            openvdb::Coord origin = leaf.origin();
            origin[axis] += kBlockDim;
            const auto at = mNumbers.find(origin);
            beside[std::size_t(axis)] = at != mNumbers.end() ? &mBand.leaf(at->second) : nullptr;
        }
        for (auto on = leaf.cbeginValueOn(); on; ++on) {
            const openvdb::Coord at = on.getCoord();
            for (int axis = 0; axis < 3; ++axis) {
                openvdb::Coord next = at;
                ++next[axis];
                const bool isHere = next[axis] & (kBlockDim - 1);
                const Leaf* const other = isHere ? &leaf : beside[std::size_t(axis)];
                float there = 0;
                if (!other || !other->probeValue(next, there) || (*on < 0) == (there < 0)) continue;
                const double apart = double(std::abs(*on) + std::abs(there)) / mTriangles.voxelSize;
                if (apart > kAcross * kRoundings) found.push_back({n, at, axis, apart});
            }
        }
    }

    /// Set the voxels of conflicts to the signs of their winding numbers, each once. @return
    /// whether there were any new voxels.
    bool resolve(const std::vector<Conflict>& conflicts, Interrupter& progress)
    {
        std::vector<openvdb::Coord> voxels;
        for (const Conflict& d : conflicts)
            for (const int step : {0, 1}) {
                openvdb::Coord voxel = d.voxel;
                voxel[d.axis] += step;
                addUnresolved(voxel, voxels);
            }
        setSigns(voxels, progress);
        return !voxels.empty();
    }

    /// Active voxels as near to a seam as any of a cell about it.
    std::vector<openvdb::Coord> besideSeams()
    {
        std::vector<openvdb::Coord> voxels;
        for (const openvdb::Coord& cell : mSolid.closure().seam)
            for (int n = 0; n < 64; ++n)
                addUnresolved(cell.offsetBy(n / 16 - 1, n / 4 % 4 - 1, n % 4 - 1), voxels);
        return voxels;
    }

    /// Add an active voxel that is not there, and remember that.
    void addUnresolved(const openvdb::Coord& voxel, std::vector<openvdb::Coord>& voxels)
    {
        const auto at = mNumbers.find(voxel & ~(kBlockDim - 1));
        if (at == mNumbers.end() || !mBand.leaf(at->second).isValueOn(voxel)) return;
        auto& resolved = mResolved[at->second];
        const auto offset = Leaf::coordToOffset(voxel);
        if (resolved.isOn(offset)) return;
        resolved.setOn(offset);
        voxels.push_back(voxel);
    }

    /// Set the signs of voxels by their winding numbers.
    void setSigns(const std::vector<openvdb::Coord>& voxels, Interrupter& progress)
    {
        std::vector<std::uint8_t> inside(voxels.size());
        tbb::parallel_for(std::size_t(0), voxels.size(), [&](std::size_t n) {
            if (n % 64 == 0) progress.check();
            inside[n] = mSolid.isInside(
                mTriangles.place(Vec3d(voxels[n].x(), voxels[n].y(), voxels[n].z())));
        });
        for (std::size_t n = 0; n < voxels.size(); ++n) {
            Leaf& leaf = mBand.leaf(mNumbers.at(voxels[n] & ~(kBlockDim - 1)));
            const float distance = std::abs(leaf.getValue(voxels[n]));
            leaf.setValueOnly(voxels[n], inside[n] ? -distance : distance);
        }
    }

    std::optional<WayThrough> widest(const std::vector<Conflict>& conflicts) const
    {
        const Conflict* widest = nullptr;
        for (const Conflict& d : conflicts)
            if (d.apart > kThroughHole * kRoundings && (!widest || d.apart > widest->apart))
                widest = &d;
        if (!widest) return std::nullopt;
        const openvdb::Coord& v = widest->voxel;
        return WayThrough{mTriangles.place(Vec3d(v.x(), v.y(), v.z())), widest->apart};
    }

    LeafManager mBand;
    const PlacedTriangles& mTriangles;
    const SolidBoundary& mSolid;
    std::unordered_map<openvdb::Coord, std::size_t> mNumbers; ///< of leaves, by origin
    std::vector<Leaf::NodeMaskType> mResolved; ///< voxels that were resolved, by leaf
};

} // namespace

std::optional<WayThrough> repairSigns(Tree& tree, const PlacedTriangles& triangles,
                                      const SolidBoundary& solid, Interrupter& progress)
{
    return SignRepair(tree, triangles, solid).run(progress);
}

} // namespace mpuvdb
