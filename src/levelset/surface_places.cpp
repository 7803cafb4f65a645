#include "surface_places.h"

#include <cmath>
#include <optional>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using openvdb::FloatGrid;
using Accessor = FloatGrid::ConstAccessor;

constexpr int kProjections = 3;
constexpr double kShortest = 0.5;   ///< of a gradient, whose length should be one
constexpr double kNearEnough = 0.2; ///< voxels off the surface

/// The gradient of the distance at a voxel, per voxel, from those neighbours that are in the band;
/// empty where an axis has none, or they contradict each other.
std::optional<Vec3d> gradientAt(const Accessor& band, const Coord& at, double value,
                                double voxelSize)
{
    Vec3d gradient;
    for (int axis = 0; axis < 3; ++axis) {
        double ends[2] = {value, value};
        int steps = 0;
        for (const int side : {0, 1}) {
            Coord next = at;
            next[axis] += 2 * side - 1;
            float v = 0;
            if (!band.probeValue(next, v)) continue;
            ends[side] = double(v);
            ++steps;
        }
        if (!steps) return std::nullopt;
        gradient[axis] = (ends[1] - ends[0]) / steps;
    }
    if (gradient.norm() < kShortest * voxelSize) return std::nullopt;
    return gradient;
}

/// Of a voxel and the 26 around it the one in the band that is nearest to the surface.
Coord nearestToSurface(const Accessor& band, const Coord& at)
{
    Coord best = at;
    float least = std::abs(band.getValue(at));
    for (int n = 0; n < 27; ++n) {
        const Coord next = at.offsetBy(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1);
        float v = 0;
        if (!band.probeValue(next, v) || !(std::abs(v) < least)) continue;
        best = next;
        least = std::abs(v);
    }
    return best;
}

/// Value and gradient (per voxel), trilinear, at @a x in index space.
double sample(const Accessor& band, const Vec3d& x, Vec3d& gradient)
{
    const Coord base = Coord::floor(openvdb::Vec3d(x[0], x[1], x[2]));
    const double t[3] = {x[0] - base[0], x[1] - base[1], x[2] - base[2]};
    double value = 0;
    gradient.setZero();
    for (int corner = 0; corner < 8; ++corner) {
        const int bit[3] = {corner & 1, corner >> 1 & 1, corner >> 2 & 1};
        const double v = double(band.getValue(base.offsetBy(bit[0], bit[1], bit[2])));
        double w[3];
        for (int k = 0; k < 3; ++k) w[k] = bit[k] ? t[k] : 1 - t[k];
        value += w[0] * w[1] * w[2] * v;
        gradient += v * Vec3d((2 * bit[0] - 1) * w[1] * w[2], (2 * bit[1] - 1) * w[0] * w[2],
                              (2 * bit[2] - 1) * w[0] * w[1]);
    }
    return value;
}

/// The place on the zero set that is nearest to an active voxel: value times gradient away. Again
/// from there, because outside an edge the band's values fall short of the distance.
SurfacePlace nearestPlace(const Accessor& band, Coord at, const Lattice& lattice)
{
    std::optional<Vec3d> known;
    double value = 0;
    for (;;) {
        value = double(band.getValue(at));
        known = gradientAt(band, at, value, lattice.voxelSize);
        const Coord next = known ? at : nearestToSurface(band, at);
        if (next == at) break;
        at = next;
    }
    Vec3d x(at[0], at[1], at[2]);
    Vec3d gradient = known.value_or(Vec3d::Zero());
    for (int n = 0; n < kProjections; ++n) {
        if (!(std::abs(value) > kNearEnough * lattice.voxelSize)) break;
        x -= value / lattice.voxelSize * gradient.normalized();
        value = sample(band, x, gradient);
    }
    return {lattice.origin + lattice.voxelSize * x, gradient.normalized()};
}

} // namespace

std::vector<SurfacePlace> surfacePlaces(const FloatGrid& surface, const Lattice& lattice,
                                        const openvdb::FloatTree::LeafNodeType& leaf)
{
    const Accessor band = surface.getConstAccessor();
    std::vector<SurfacePlace> places;
    for (auto voxel = leaf.cbeginValueOn(); voxel; ++voxel)
        places.push_back(nearestPlace(band, voxel.getCoord(), lattice));
    return places;
}

} // namespace mpuvdb
