#include "resample.h"

#include "distance/far_field.h"
#include "grid/band_limits.h"
#include "grid/transform_lattice.h"
#include "sampling/solid_blocks.h"
#include "solid_measures.h"
#include "surface/surface_integrals.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/operations.h>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

/// The band, in voxels, that interpolation reads beyond a place. [derived: two of the cubic
/// stencil, half a voxel of position]
constexpr double kStencil = 2.5;
/// The half-width, in voxels of the source, in which its own values are taken where others are
/// searched. [derived: the nearest voxels of any place on the surface]
constexpr double kOwnWidth = 0.5;
/// The relative difference up to which half-widths are equal. [derived: backgrounds are floats]
constexpr double kRounding = 1e-6;

bool isWhole(double x)
{
    return std::abs(x - std::round(x)) < 1e-6;
}

/// Whether each voxel of @a to is one of @a from.
bool isPartOf(const Lattice& to, const Lattice& from)
{
    const Vec3d shift = (to.origin - from.origin) / from.voxelSize;
    return isWhole(to.voxelSize / from.voxelSize) && isWhole(shift[0]) && isWhole(shift[1]) &&
           isWhole(shift[2]);
}

/// The voxels of @a from that interpolation reads beyond the band.
double beyond(const Lattice& from, const Lattice& to)
{
    return isPartOf(to, from) ? 0 : kStencil;
}

/// Note where larger voxels change the volume by more than they change that of the smallest ball
/// that a band resolves.
void noteLoss(const LevelSet& fine, const LevelSet& coarse, Interrupter& progress)
{
    // Sums over the fine voxels are nearly exact, in a fraction of the time of their surface.
    const double sum = SolidBlocks(fine, progress).sums().volume,
                 after = integrateSurface(measurable(coarse, progress), progress).volume;
    if (std::abs(after - sum) <= kSmallBallShare * sum) return;
    const double before = integrateSurface(measurable(fine, progress), progress).volume;
    progress.note(fmt::format("voxels of {:.4g} are too large for the solid: its volume was {:.4g} "
                              "and is {:.4g}. Take smaller ones",
                              coarse.voxelSize(), before, after));
}

} // namespace

double widthToResample(const Lattice& from, const Lattice& to, double halfWidth)
{
    return isSearched(from, to) ? kStencil + kOwnWidth
                                : halfWidth * to.voxelSize / from.voxelSize + beyond(from, to);
}

bool isSearched(const Lattice& from, const Lattice& to)
{
    return to.voxelSize > from.voxelSize * (1 + kRounding);
}

LevelSet resample(const LevelSet& levelSet, const Lattice& lattice, double halfWidth,
                  Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    requireVoxelSize(lattice.voxelSize);
    requireHalfWidth(halfWidth);
    const Lattice from = levelSet.lattice();
    if (from.origin == lattice.origin && from.voxelSize == lattice.voxelSize) {
        const bool same = std::abs(levelSet.halfWidth() - halfWidth) <= kRounding * halfWidth;
        return same ? levelSet : withHalfWidth(levelSet, halfWidth, &progress);
    }
    const std::string name = levelSet.grid().getName();
    if (levelSet.grid().tree().activeVoxelCount() == 0)
        return emptyLevelSet(lattice, halfWidth, name);

    const double ratio = lattice.voxelSize / from.voxelSize;
    if (ratio > kMaxHalfWidth)
        throw LimitError(fmt::format("voxels of {:g} are {:.4g} times those of the level "
                                     "set, and may be {:g} times: take voxels of at most {:.4g}",
                                     lattice.voxelSize, ratio, kMaxHalfWidth,
                                     kMaxHalfWidth * from.voxelSize));
    const double least = widthToResample(from, lattice, halfWidth);
    const LevelSet source = levelSet.halfWidth() < least * (1 - kRounding)
                                ? withHalfWidth(levelSet, least, &progress)
                                : levelSet;
    SampleSettings settings;
    settings.lattice = lattice;
    settings.halfWidth = std::min(halfWidth, 100.0);
    settings.name = name;
    const FieldPtr field = isSearched(from, lattice)
                               ? makeFarField(source, source.halfWidth() - kStencil, progress)
                               : makeGridField(source);
    const LevelSet result = sampleField(*field, settings, &progress);
    if (ratio > 1) noteLoss(levelSet, result, progress);
    return settings.halfWidth < halfWidth ? withHalfWidth(result, halfWidth, &progress) : result;
}

} // namespace mpuvdb
