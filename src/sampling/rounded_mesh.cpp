#include "rounded_mesh.h"

#include <mpuvdb/triangle_mesh.h>

#include <cmath>
#include <fmt/format.h>
#include <limits>

namespace mpuvdb
{
namespace
{

/// Largest step that voxels do not show, voxels. [derived: half of it is the error of a surface
/// between voxels]
constexpr double kMaxStep = 1.0 / 8;
/// Least share of coarse coordinates that are odd multiples of their step. [derived: half of those
/// that were rounded are, and none of whole numbers far from 2^24]
constexpr double kMinOdd = 0.25;

/// The step between floats at @a value.
double stepAt(double value)
{
    return value == 0 ? 0 : std::ldexp(1.0, std::ilogb(value) - 23); // a float has 24 bits
}

/// The coarsest step of an axis, world units; 0 if its coordinates are no floats, or in fine steps.
double coarsestStep(const Mesh& mesh, int axis, double voxelSize)
{
    std::size_t coarse = 0, odd = 0;
    double coarsest = 0;
    for (std::size_t v = 0; v < mesh.positions.size(); ++v) {
        const double value = mesh.world(v)[axis], step = stepAt(value);
        if (double(float(value)) != value) return 0;
        // Where the step is 1, whole numbers look the same.
        if (!(step > kMaxStep * voxelSize) || step == 1) continue;
        ++coarse;
        odd += std::fmod(std::abs(value) / step, 2) == 1;
        coarsest = std::max(coarsest, step);
    }
    return double(odd) >= kMinOdd * double(coarse) ? coarsest : 0;
}

} // namespace

std::optional<std::string> roundingOf(const Mesh& mesh, double voxelSize)
{
    double coarsest = 0;
    for (int axis = 0; axis < 3; ++axis)
        coarsest = std::max(coarsest, coarsestStep(mesh, axis, voxelSize));
    if (coarsest == 0) return std::nullopt;
    return fmt::format(
        "the mesh's positions are floats of 32 bits, which lie {:.3g} apart so far from "
        "the origin: faces are off by up to {:.2g} voxels of {:.4g}. Subtract an "
        "offset from the coordinates before they are written, or write doubles",
        coarsest, coarsest / 2 / voxelSize, voxelSize);
}

} // namespace mpuvdb
