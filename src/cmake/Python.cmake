# Finds pybind11 and the Python that it belongs to; sets MPUVDB_PYTHON_WANTED, whether the Python module
# is built unless told.
#
# The first python3 on the PATH is often one of pyenv, conda or a virtual environment, without numpy and
# OpenVDB's module. So the one beside pybind11 comes first: the distribution's, where pybind11 is the
# distribution's. Python_EXECUTABLE names another.
set(PYBIND11_NOPYTHON ON) # it would look for a Python in its own way
if(PROJECT_IS_TOP_LEVEL OR MPUVDB_PYTHON)
    find_package(pybind11 2.10 CONFIG QUIET)
endif()
if(pybind11_FOUND)
    cmake_path(GET pybind11_INCLUDE_DIR PARENT_PATH prefix)
    find_program(Python_EXECUTABLE python3 PATHS ${prefix}/bin NO_DEFAULT_PATH)
    if(NOT Python_EXECUTABLE)
        unset(Python_EXECUTABLE CACHE)
    endif()
    find_package(Python 3.8 QUIET COMPONENTS Interpreter Development.Module)
endif()

set(MPUVDB_PYTHON_WANTED OFF)
# A sanitizer would have to be loaded before the interpreter.
if(PROJECT_IS_TOP_LEVEL AND TARGET Python::Module AND NOT MPUVDB_SANITIZE)
    set(MPUVDB_PYTHON_WANTED ON)
endif()
