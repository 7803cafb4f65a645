// Errors of measurement: holes, noise, outliers.
#pragma once
#include "surface_sampling.h"

namespace mpuvdb
{

/// Removes the points within settings.holeRadius of settings.holes random surface points.
void cutHoles(const Solid& solid, const ScanSettings& settings, RangeScans& scans,
              Interrupter& progress);

/// The cloud that a device would deliver: noise along the ray (without rays along the normal),
/// turned normals, outliers, confidences.
PointCloud measureWithNoise(const Solid& solid, const ScanSettings& settings, RangeScans&& scans,
                            Interrupter& progress);

} // namespace mpuvdb
