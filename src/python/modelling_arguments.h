// What operations on shapes and on level sets are told alike.
#pragma once
#include "arguments.h"

#include <mpuvdb/operations.h>

#include <pybind11/pybind11.h>

#include <string>

namespace mpuvdb::python
{

/// "inward", "outward", "centered". @throws UsageError
Wall wallOf(const std::string& wall);

/// "mean", "gaussian", "median", "curvature". @param mask  a FloatGrid of OpenVDB's own module, or
/// None. @throws UsageError
SmoothSettings smoothSettings(const std::string& filter, int iterations, int width,
                              const pybind11::object& mask);

#define MPUVDB_SMOOTH_DOC                                                                          \
    "Smoothed; filter is 'mean', 'gaussian', 'median' or 'curvature', width its reach in voxels, " \
    "in [1, 32] (not for curvature), iterations in [1, 1000]. mask, a FloatGrid of OpenVDB's own " \
    "Python module with values in [0, 1], says where and how much; None: everywhere, in full."

} // namespace mpuvdb::python
