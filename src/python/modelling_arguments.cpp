#include "modelling_arguments.h"

#include "pyopenvdb.h"

namespace mpuvdb::python
{
namespace py = pybind11;

Wall wallOf(const std::string& wall)
{
    return choose<Wall>(wall, "wall",
                        {{"inward", Wall::Inward},
                         {"outward", Wall::Outward},
                         {"centered", Wall::Centered},
                         {"centred", Wall::Centered}});
}

SmoothSettings smoothSettings(const std::string& filter, int iterations, int width,
                              const py::object& mask)
{
    SmoothSettings settings;
    settings.filter = choose<Filter>(filter, "filter",
                                     {{"mean", Filter::Mean},
                                      {"gaussian", Filter::Gaussian},
                                      {"median", Filter::Median},
                                      {"curvature", Filter::MeanCurvature}});
    settings.iterations = iterations;
    settings.width = width;
    if (!mask.is_none()) settings.mask = fromPyOpenVdb(mask, "mask");
    return settings;
}

} // namespace mpuvdb::python
