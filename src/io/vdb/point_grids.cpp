#include "point_grids.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/io.h>

#include <fmt/format.h>
#include <openvdb/points/AttributeArray.h>
#include <openvdb/points/PointDataGrid.h>

#include <algorithm>
#include <set>

namespace mpuvdb
{
namespace
{

namespace points = openvdb::points;
using points::PointDataGrid;
using Leaf = points::PointDataTree::LeafNodeType;

/// Append the values of an attribute with values of type From. @return whether it has that type.
template <class From, class To, class Convert>
bool appendAs(const points::AttributeArray& array, std::vector<To>& to, const Convert& convert)
{
    if (array.valueType() != openvdb::typeNameAsString<From>()) return false;
    const points::AttributeHandle<From> values(array);
    for (openvdb::Index n = 0; n < array.size(); ++n) to.push_back(convert(values.get(n)));
    return true;
}

bool appendNumbers(const points::AttributeArray& array, std::vector<float>& to)
{
    const auto convert = [](auto value) { return float(value); };
    return appendAs<float>(array, to, convert) || appendAs<double>(array, to, convert) ||
           appendAs<std::int32_t>(array, to, convert) || appendAs<std::int64_t>(array, to, convert);
}

bool appendVectors(const points::AttributeArray& array, std::vector<Vec3f>& to)
{
    const auto convert = [](const auto& v) { return Vec3f(float(v[0]), float(v[1]), float(v[2])); };
    return appendAs<openvdb::Vec3f>(array, to, convert) ||
           appendAs<openvdb::Vec3d>(array, to, convert);
}

/// What the point grids of a file hold.
class GatheredPoints
{
public:
    GatheredPoints(std::string file, std::vector<std::string> scalars)
        : mFile(std::move(file)), mScalarNames(std::move(scalars)), mScalars(mScalarNames.size())
    {
    }

    void add(const PointDataGrid& grid, Interrupter& progress)
    {
        for (auto leaf = grid.tree().cbeginLeaf(); leaf; ++leaf) {
            progress.check();
            addPositions(grid, *leaf);
            const points::AttributeSet& attributes = leaf->attributeSet();
            for (const auto& entry : attributes.descriptor().map()) mThere.insert(entry.first);
            if (!addNumbers(attributes, "pscale", mRadii)) addNumbers(attributes, "radius", mRadii);
            if (const auto* v = attributes.get("v")) appendVectors(*v, mVelocities);
            if (const auto* c = attributes.get("Cd")) appendVectors(*c, mColors);
            for (std::size_t n = 0; n < mScalars.size(); ++n)
                addNumbers(attributes, mScalarNames[n], mScalars[n]);
        }
    }
    /// The particles, about a frame. @throws InputError where attributes are missing.
    Particles particles(Interrupter& progress)
    {
        if (mPositions.empty())
            throw InputError(fmt::format("{}: has no points in its grids. Name a file with a point "
                                         "grid (openvdb::points::PointDataGrid), or a .ply file",
                                         mFile));
        ParticleView view;
        view.positions = mPositions;
        if (isWhole(mRadii)) view.radii = mRadii;
        if (isWhole(mVelocities)) view.velocities = mVelocities;
        // Cd is linear, as it is in grids.
        std::vector<Rgb> colors;
        if (isWhole(mColors)) {
            for (const Vec3f& color : mColors) colors.push_back(srgbColor(color));
            view.colors = colors;
        }
        for (std::size_t n = 0; n < mScalars.size(); ++n) {
            if (!isWhole(mScalars[n]))
                throw InputError(fmt::format("{}: has no number '{}' at each of its points, but "
                                             "{}. Name one that all have, or leave it out",
                                             mFile, mScalarNames[n], fmt::join(mThere, ", ")));
            view.scalars.emplace_back(mScalarNames[n], mScalars[n]);
        }
        return importParticles(view, &progress);
    }

private:
    template <class T>
    bool isWhole(const std::vector<T>& values) const
    {
        return values.size() == mPositions.size();
    }
    static bool addNumbers(const points::AttributeSet& attributes, const std::string& name,
                           std::vector<float>& to)
    {
        const points::AttributeArray* const array = attributes.get(name);
        return array && appendNumbers(*array, to);
    }
    void addPositions(const PointDataGrid& grid, const Leaf& leaf)
    {
        const points::AttributeArray* const array = leaf.attributeSet().get("P");
        if (!array) return;
        std::vector<Vec3f> offsets;
        if (!appendVectors(*array, offsets))
            throw InputError(fmt::format("{}: the positions of its points are no vectors of "
                                         "floats. Write them again",
                                         mFile));
        // A leaf's points are sorted by their voxels, whose values are the ends of their points.
        openvdb::Index next = 0;
        for (openvdb::Index n = 0; n < Leaf::SIZE; ++n) {
            const openvdb::Vec3d voxel = leaf.offsetToGlobalCoord(n).asVec3d();
            const auto end = std::min(openvdb::Index(leaf.getValue(n)), array->size());
            for (; next < end; ++next) {
                const Vec3f& p = offsets[next];
                const openvdb::Vec3d at =
                    grid.transform().indexToWorld(voxel + openvdb::Vec3d(p.x(), p.y(), p.z()));
                mPositions.push_back({at.x(), at.y(), at.z()});
            }
        }
    }

    std::string mFile;
    std::vector<std::string> mScalarNames;
    std::vector<Vec3d> mPositions;
    std::vector<float> mRadii;
    std::vector<Vec3f> mVelocities, mColors;
    std::vector<std::vector<float>> mScalars;
    std::set<std::string> mThere; ///< names of attributes
};

} // namespace

Particles readPointGrids(const std::filesystem::path& file, const std::vector<std::string>& scalars,
                         std::uint64_t maxBytes, Interrupter& progress)
{
    GatheredPoints points(file.string(), scalars);
    for (const openvdb::GridBase::Ptr& grid : readGrids(file, maxBytes, &progress))
        if (const auto found = openvdb::gridPtrCast<PointDataGrid>(grid))
            points.add(*found, progress);
    return points.particles(progress);
}

} // namespace mpuvdb
