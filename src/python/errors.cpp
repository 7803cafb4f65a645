#include "errors.h"

#include <mpuvdb/error.h>

#include <string>

namespace mpuvdb::python
{
namespace py = pybind11;
namespace
{

/// Kept for as long as the process lives: translators outlive the module.
struct Types {
    PyObject *error, *usage, *input, *io, *limit, *interrupted;
};
Types gTypes;

PyObject* makeType(py::module_& module, const char* name, const char* doc, const py::tuple& bases)
{
    const std::string full = std::string("mpuvdb.") + name;
    PyObject* const type = PyErr_NewExceptionWithDoc(full.c_str(), doc, bases.ptr(), nullptr);
    if (!type) throw py::error_already_set();
    module.add_object(name, type);
    return type;
}

PyObject* typeOf(const Error& error)
{
    if (dynamic_cast<const UsageError*>(&error)) return gTypes.usage;
    if (dynamic_cast<const InputError*>(&error)) return gTypes.input;
    if (dynamic_cast<const IoError*>(&error)) return gTypes.io;
    if (dynamic_cast<const LimitError*>(&error)) return gTypes.limit;
    if (dynamic_cast<const Interrupted*>(&error)) return gTypes.interrupted;
    return gTypes.error;
}

void translate(std::exception_ptr thrown)
{
    try {
        if (thrown) std::rethrow_exception(thrown);
    } catch (const Error& error) {
        PyErr_SetString(typeOf(error), error.what());
    }
}

} // namespace

void bindErrors(py::module_& module)
{
    gTypes.error = makeType(module, "Error",
                            "Base of everything mpuvdb raises on purpose. The message says what is "
                            "wrong, where, and the cure.",
                            py::make_tuple(py::handle(PyExc_Exception)));
    const py::handle base = gTypes.error;
    gTypes.usage = makeType(module, "UsageError",
                            "What was asked for makes no sense: a value, a range, a unit.",
                            py::make_tuple(base, py::handle(PyExc_ValueError)));
    gTypes.input = makeType(module, "InputError",
                            "The data are unusable: a malformed file, no points, a grid that is no "
                            "level set.",
                            py::make_tuple(base));
    gTypes.io = makeType(module, "IoError",
                         "The operating system refused to open, read, write or rename a file.",
                         py::make_tuple(base, py::handle(PyExc_OSError)));
    gTypes.limit = makeType(module, "LimitError",
                            "The work would exceed a limit: memory, voxels, index range.",
                            py::make_tuple(base));
    gTypes.interrupted = makeType(module, "Interrupted",
                                  "A progress callback returned False; nothing partial is left "
                                  "behind. (Ctrl-C raises KeyboardInterrupt.)",
                                  py::make_tuple(base));
    py::register_exception_translator(translate);
}

} // namespace mpuvdb::python
