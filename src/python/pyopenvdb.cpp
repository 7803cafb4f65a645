#include "pyopenvdb.h"

#include "run.h"

#include <mpuvdb/error.h>
#include <mpuvdb/io.h>

#include <fmt/format.h>
#include <openvdb/io/File.h>

namespace mpuvdb::python
{
namespace py = pybind11;
namespace
{

/// A folder that goes with the object.
class TemporaryFolder
{
public:
    TemporaryFolder()
        : mFolder(py::module_::import("tempfile").attr("TemporaryDirectory")("", "mpuvdb-"))
    {
    }
    TemporaryFolder(const TemporaryFolder&) = delete;
    TemporaryFolder& operator=(const TemporaryFolder&) = delete;
    ~TemporaryFolder()
    {
        try {
            mFolder.attr("cleanup")();
        } catch (py::error_already_set& error) {
            error.discard_as_unraisable("mpuvdb: temporary folder");
        }
    }
    std::string file() const { return mFolder.attr("name").cast<std::string>() + "/grid.vdb"; }

private:
    py::object mFolder;
};

/// OpenVDB's module: "openvdb" from version 11 on, "pyopenvdb" before.
py::module_ openvdbModule()
{
    const auto find = py::module_::import("importlib.util").attr("find_spec");
    for (const char* name : {"openvdb", "pyopenvdb"})
        if (!find(name).is_none()) return py::module_::import(name);
    throw py::import_error("OpenVDB's Python module is not installed (Debian: apt-get install "
                           "python3-openvdb)");
}

/// Bytes go as they are: the file lives but for a moment.
void writeQuickly(const std::string& file, const openvdb::FloatGrid::ConstPtr& grid)
{
    try {
        openvdb::io::File out(file);
        out.setCompression(openvdb::io::COMPRESS_ACTIVE_MASK);
        out.setGridStatsMetadataEnabled(false);
        out.write(openvdb::GridCPtrVec{grid});
        out.close();
    } catch (const openvdb::Exception& error) {
        throw IoError(fmt::format("{}: {}. Is the disk full?", file, error.what()));
    }
}

} // namespace

py::object toPyOpenVdb(const openvdb::FloatGrid& grid)
{
    const py::module_ module = openvdbModule();
    const TemporaryFolder folder;
    const std::string file = folder.file();
    runWork(py::none(), [&](Progress&) { writeQuickly(file, grid.copy()); });
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
    return run(py::none(), [&](Progress&) {
        const auto grid = openvdb::gridPtrCast<openvdb::FloatGrid>(readGrids(file).front());
        demandFinite(*grid);
        return grid;
    });
}

} // namespace mpuvdb::python
