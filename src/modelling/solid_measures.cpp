// Measures of a solid.
#include "solid_measures.h"

#include "half_widths.h"
#include "thickness.h"
#include <mpuvdb/interrupter.h>
#include <mpuvdb/operations.h>

namespace mpuvdb
{

LevelSet measurable(const LevelSet& levelSet, Interrupter& progress)
{
    return levelSet.halfWidth() < kMeasuredHalfWidth * (1 - kSameHalfWidth)
               ? withHalfWidth(levelSet, kMeasuredHalfWidth, &progress)
               : levelSet;
}

SolidMeasures measure(const LevelSet& levelSet, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    const LevelSet band = measurable(levelSet, progress);
    progress.beginStage("measure", 2);
    const SurfaceIntegrals sums = integrateSurface(band, progress);
    progress.advance();
    const Thickness thickness = measureThickness(band, sums.crossings, progress);
    progress.endStage();
    SolidMeasures measures;
    measures.volume = sums.volume;
    measures.area = sums.area;
    measures.bounds = sums.bounds;
    measures.eulerCharacteristic = sums.eulerCharacteristic;
    measures.surfaces = sums.surfaces;
    measures.genus = sums.genus();
    measures.minThickness = thickness.least;
    measures.meanThickness = thickness.mean;
    return measures;
}

} // namespace mpuvdb
