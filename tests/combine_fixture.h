// What the tests of Booleans share: exact solids, and how far values are from exact distances.
#pragma once
#include "solid_level_set.h"

#include <fmt/format.h>

#include <cstdlib>

namespace mpuvdb::test
{

using openvdb::Coord;
using Accessor = openvdb::FloatGrid::ConstAccessor;
using Exact = std::function<double(const Vec3d&)>;

inline LevelSet combined(Boolean kind, const std::vector<LevelSet>& inputs, double radius = 0)
{
    Interrupter progress;
    return combine(kind, inputs, radius, &progress);
}

inline LevelSet operator|(const LevelSet& a, const LevelSet& b)
{
    return combined(Boolean::Union, {a, b});
}

inline LevelSet operator&(const LevelSet& a, const LevelSet& b)
{
    return combined(Boolean::Intersection, {a, b});
}

inline LevelSet operator-(const LevelSet& a, const LevelSet& b)
{
    return combined(Boolean::Difference, {a, b});
}

inline CheckReport checked(const LevelSet& levelSet, double gradientTolerance = 0.1)
{
    Interrupter progress;
    return check(levelSet.grid(), gradientTolerance, openvdb::CoordBBox::inf(), &progress);
}

inline void expectSoundCreases(const LevelSet& levelSet, double gradientTolerance = 0.1)
{
    const CheckReport report = checked(levelSet, gradientTolerance);
    EXPECT_TRUE(report.sound()) << texts(report);
}

inline std::string bytesOf(const LevelSet& levelSet)
{
    return treeBytes(levelSet.grid());
}

/// Voxels where either is active and the values differ by more than @a voxels, or the signs do.
inline std::uint64_t differences(const LevelSet& a, const LevelSet& b, double voxels)
{
    std::uint64_t count = 0;
    const auto compare = [&](const LevelSet& active, const LevelSet& other) {
        const Accessor at = other.grid().getConstAccessor();
        for (auto it = active.grid().cbeginValueOn(); it; ++it) {
            const float v = at.getValue(it.getCoord());
            count += std::abs(double(v) - double(*it)) > voxels * a.voxelSize() ||
                     ((v < 0) != (*it < 0) && std::abs(*it) > 1e-5 * a.voxelSize());
        }
    };
    compare(a, b);
    compare(b, a);
    return count;
}

/// What a band's values are off the exact distance, in voxels.
struct Errors {
    double rms = 0, max = 0;
    std::uint64_t voxels = 0, wrongSigns = 0;
    Coord worst;
};

/// Over all voxels within the band in a box (world units) about the origin.
inline Errors errorsOf(const LevelSet& levelSet, const Exact& exact, double half)
{
    const double h = levelSet.voxelSize(), background = levelSet.grid().background();
    const int reach = int(half / h);
    const Accessor at = levelSet.grid().getConstAccessor();
    Errors errors;
    for (int x = -reach; x <= reach; ++x)
        for (int y = -reach; y <= reach; ++y)
            for (int z = -reach; z <= reach; ++z) {
                const double d = exact(h * Vec3d(x, y, z));
                const double value = double(at.getValue(Coord(x, y, z)));
                errors.wrongSigns += (d < 0) != (value < 0) && std::abs(d) > 0.05 * h;
                if (std::abs(d) >= background && !at.isValueOn(Coord(x, y, z))) continue;
                const double clamped = std::max(-background, std::min(background, d));
                const double error = std::abs(value - clamped) / h;
                errors.rms += error * error;
                if (error > errors.max) {
                    errors.max = error;
                    errors.worst = Coord(x, y, z);
                }
                ++errors.voxels;
            }
    errors.rms = std::sqrt(errors.rms / double(std::max<std::uint64_t>(errors.voxels, 1)));
    return errors;
}

inline void expectNear(const LevelSet& levelSet, const Exact& exact, double half, double rms,
                       double max)
{
    const Errors errors = errorsOf(levelSet, exact, half);
    EXPECT_GT(errors.voxels, 100u);
    EXPECT_EQ(errors.wrongSigns, 0u);
    EXPECT_LE(errors.rms, rms);
    EXPECT_LE(errors.max, max) << errors.worst << ": "
                               << levelSet.grid().getConstAccessor().getValue(errors.worst) /
                                      levelSet.voxelSize()
                               << " for "
                               << exact(worldOf(levelSet.lattice(), errors.worst)) /
                                      levelSet.voxelSize();
    if (std::getenv("MPUVDB_TEST_FIGURES"))
        fmt::print("  rms {:.5f} max {:.5f} of {}\n", errors.rms, errors.max, errors.voxels);
}

} // namespace mpuvdb::test
