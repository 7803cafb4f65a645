// What the tests of fields and operations share: grids from fields, checked against functions.
#pragma once
#include "field_fixture.h"

#include <mpuvdb/fields.h>
#include <mpuvdb/mesh.h>
#include <mpuvdb/operations.h>

#include <gtest/gtest.h>

#include <functional>

namespace mpuvdb::test
{

inline FieldPtr solidField(const std::string& description)
{
    return makeSolidField(parseSolid(description));
}

inline LevelSet sampled(const Field& field, double voxelSize, double halfWidth = 3,
                        const Vec3d& origin = Vec3d::Zero())
{
    SampleSettings settings;
    settings.lattice = {origin, voxelSize};
    settings.halfWidth = halfWidth;
    Interrupter progress;
    return sampleField(field, settings, &progress);
}

inline void expectSound(const LevelSet& levelSet)
{
    Interrupter progress;
    const CheckReport report =
        check(levelSet.grid(), kGradientTolerance, openvdb::CoordBBox::inf(), &progress);
    EXPECT_TRUE(report.sound()) << texts(report);
}

inline MeshReport meshed(const LevelSet& levelSet)
{
    Interrupter progress;
    return measure(extractMesh(levelSet, {}, &progress));
}

/// How far the values are from a distance, in voxels.
struct Deviation {
    double mean = 0, largest = 0;
    std::uint64_t voxels = 0;
    std::uint64_t wrongSigns = 0; ///< beyond a tenth of a voxel from the surface
};

/// Over the voxels within @a reach voxels of the surface.
inline Deviation deviation(const LevelSet& levelSet,
                           const std::function<double(const Vec3d&)>& distance, double reach = 100)
{
    const Lattice lattice = levelSet.lattice();
    Deviation result;
    for (auto on = levelSet.grid().cbeginValueOn(); on; ++on) {
        const double d = distance(worldOf(lattice, on.getCoord())) / lattice.voxelSize;
        if (std::abs(d) > reach) continue;
        const double value = double(*on) / lattice.voxelSize, error = std::abs(value - d);
        result.mean += error;
        result.largest = std::max(result.largest, error);
        result.wrongSigns += std::abs(d) > 0.1 && (value < 0) != (d < 0);
        ++result.voxels;
    }
    result.mean /= double(std::max<std::uint64_t>(result.voxels, 1));
    return result;
}

/// Random places about a box, as often as asked.
template <class F>
void forRandomPlaces(const Box3d& box, std::uint64_t seed, int count, F&& f)
{
    SCOPED_TRACE("seed " + std::to_string(seed));
    Random random(seed);
    for (int i = 0; i < count; ++i) {
        const Vec3d u(random.uniform(), random.uniform(), random.uniform());
        f(Vec3d(box.min() + u.cwiseProduct(box.sizes())), random);
    }
}

} // namespace mpuvdb::test
