// The library's exceptions as Python's.
#pragma once
#include <pybind11/pybind11.h>

namespace mpuvdb::python
{

/// Add Error and the types derived from it to @a module, and translate what C++ throws.
void bindErrors(pybind11::module_& module);

} // namespace mpuvdb::python
