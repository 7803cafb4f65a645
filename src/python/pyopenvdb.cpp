#include "pyopenvdb.h"

#include "run.h"

#include <mpuvdb/error.h>
#include <mpuvdb/io.h>

#include <fmt/format.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>

namespace mpuvdb::python
{
namespace py = pybind11;
namespace
{

/// A folder that goes with the object. Python code would hear of Ctrl-C while it takes it away, and
/// leave it.
class TemporaryFolder
{
public:
    TemporaryFolder()
    {
        const py::object parent = py::module_::import("tempfile").attr("gettempdir")();
        std::string folder = parent.cast<std::string>() + "/mpuvdb-XXXXXX";
        if (!mkdtemp(folder.data()))
            throw IoError(fmt::format("{}: no folder can be made there: {}. Set TMPDIR", folder,
                                      std::strerror(errno)));
        mFolder = folder;
    }
    TemporaryFolder(const TemporaryFolder&) = delete;
    TemporaryFolder& operator=(const TemporaryFolder&) = delete;
    ~TemporaryFolder()
    {
        std::error_code ignored;
        std::filesystem::remove_all(mFolder, ignored);
    }
    std::string file() const { return mFolder / "grid.vdb"; }

private:
    std::filesystem::path mFolder;
};

/// OpenVDB's module: "openvdb" from version 11 on, "pyopenvdb" before. It is not looked for but
/// imported: an import that Ctrl-C met leaves a module without a specification, which can be had
/// but not found.
py::module_ openvdbModule()
{
    for (const char* name : {"openvdb", "pyopenvdb"}) {
        try {
            return py::module_::import(name);
        } catch (const py::error_already_set& error) {
            const bool isAbsent = error.matches(PyExc_ModuleNotFoundError) &&
                                  py::str(name).equal(error.value().attr("name"));
            if (!isAbsent) throw;
        }
    }
    throw py::import_error("OpenVDB's Python module is not installed (Debian: apt-get install "
                           "python3-openvdb)");
}

} // namespace

py::object toPyOpenVdb(const openvdb::FloatGrid& grid)
{
    const py::module_ module = openvdbModule();
    const TemporaryFolder folder;
    const std::string file = folder.file();
    runWork(py::none(), [&](Interrupter& p) { writeGrids(file, {grid.copy()}, &p); });
    return module.attr("read")(file, grid.getName());
}

openvdb::FloatGrid::Ptr fromPyOpenVdb(const py::object& object, const char* what)
{
    const py::module_ module = openvdbModule();
    if (!py::isinstance(object, module.attr("FloatGrid")))
        throw UsageError(fmt::format("{}: is no FloatGrid of {}, but a {}", what,
                                     module.attr("__name__").cast<std::string>(),
                                     py::type::of(object).attr("__name__").cast<std::string>()));
    const TemporaryFolder folder;
    const std::string file = folder.file();
    module.attr("write")(file, object);
    return run(py::none(), [&](Interrupter& p) {
        auto grid = openvdb::gridPtrCast<openvdb::FloatGrid>(readGrids(file, 0, &p).front());
        p.check();
        requireFinite(*grid);
        return grid;
    });
}

} // namespace mpuvdb::python
