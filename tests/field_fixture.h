// What the tests of fits and reconstructions share: random numbers, clouds, grids compared.
#pragma once
#include <mpuvdb/interrupter.h>
#include <mpuvdb/level_set.h>
#include <mpuvdb/scan_sampler.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <sstream>
#include <string>

namespace mpuvdb::test
{

/// The same numbers everywhere: the engine is the standard's, the distributions are not.
class Random
{
public:
    explicit Random(std::uint64_t seed) : mEngine(seed) {}

    double uniform() { return double(mEngine() >> 11) * 0x1p-53; }
    double uniform(double low, double high) { return low + (high - low) * uniform(); }
    std::size_t below(std::size_t n) { return std::size_t(mEngine() % n); }
    Vec3d inCube(double half)
    {
        const double x = uniform(-half, half), y = uniform(-half, half), z = uniform(-half, half);
        return {x, y, z};
    }
    Vec3d inBall(double radius)
    {
        for (;;) {
            const Vec3d p = inCube(1);
            if (p.squaredNorm() <= 1) return radius * p;
        }
    }
    Vec3d direction()
    {
        for (;;) {
            const Vec3d p = inBall(1);
            if (p.norm() > 0.1) return p.normalized();
        }
    }

private:
    std::mt19937_64 mEngine;
};

/// Distance to a box about the origin with edges of twice @a half.
inline double boxDistance(const Vec3d& p, const Vec3d& half)
{
    const Vec3d beyond = p.cwiseAbs() - half;
    return beyond.cwiseMax(0).norm() + std::min(beyond.maxCoeff(), 0.0);
}

/// Values at random in [-1,1] in a cube of @a edge voxels, outside at its faces: cells of all
/// kinds.
inline LevelSet randomLevelSet(int edge, Random& random)
{
    auto grid = openvdb::FloatGrid::create(3);
    grid->setGridClass(openvdb::GRID_LEVEL_SET);
    auto accessor = grid->getAccessor();
    const auto ends = [&](int i) { return i == 0 || i == edge; };
    for (int x = 0; x <= edge; ++x)
        for (int y = 0; y <= edge; ++y)
            for (int z = 0; z <= edge; ++z)
                accessor.setValue(
                    {x, y, z}, ends(x) || ends(y) || ends(z) ? 1.0f : float(random.uniform(-1, 1)));
    return LevelSet(grid);
}

inline PointCloud scanOf(const std::string& solid, const ScanSettings& settings)
{
    Interrupter progress;
    return scan(*parseSolid(solid), settings, &progress);
}

/// Noise-free random points on @a solid.
inline PointCloud randomScan(const std::string& solid, double points)
{
    ScanSettings settings;
    settings.points = std::uint64_t(points);
    settings.pattern = ScanSettings::Pattern::Random;
    return scanOf(solid, settings);
}

/// The same points in another order.
inline PointCloud shuffled(const PointCloud& cloud, std::uint64_t seed)
{
    PointCloud result = cloud;
    Random random(seed);
    for (std::size_t i = cloud.size(); i > 1; --i) {
        const std::size_t j = random.below(i);
        std::swap(result.positions[i - 1], result.positions[j]);
        std::swap(result.normals[i - 1], result.normals[j]);
        if (!result.confidence.empty()) std::swap(result.confidence[i - 1], result.confidence[j]);
    }
    return result;
}

/// All that a tree holds, as bytes: tiles, masks, values.
inline std::string treeBytes(const openvdb::FloatGrid& grid)
{
    std::ostringstream out(std::ios::binary);
    grid.tree().writeTopology(out);
    grid.tree().writeBuffers(out);
    return out.str();
}

inline std::string texts(const CheckReport& report)
{
    std::ostringstream out;
    for (const CheckFinding& f : report.findings)
        out << f.what << " at " << f.voxel << " (" << f.count << ")\n";
    return out.str();
}

inline Vec3d worldOf(const Lattice& lattice, const openvdb::Coord& c)
{
    return lattice.origin + lattice.voxelSize * Vec3d(c[0], c[1], c[2]);
}

} // namespace mpuvdb::test
