// Level sets to and from OpenVDB's own Python module, which is built apart from this one.
#pragma once
#include <mpuvdb/level_set.h>

#include <pybind11/pybind11.h>

namespace mpuvdb::python
{

/// The two modules share no types: grids go through a temporary file, exactly as they are.
/// @throws ImportError (of Python) where OpenVDB's module is not installed, IoError.
pybind11::object toPyOpenVdb(const openvdb::FloatGrid& grid);
/// @param what  for messages. @throws UsageError unless @a object is one of OpenVDB's FloatGrids.
openvdb::FloatGrid::Ptr fromPyOpenVdb(const pybind11::object& object, const char* what);

} // namespace mpuvdb::python
