// Meshes of the same points: ours, and PoissonRecon's.
#pragma once

#include <mpuvdb/interrupter.h>
#include <mpuvdb/io.h>
#include <mpuvdb/mesh.h>
#include <mpuvdb/point_cloud.h>
#include <mpuvdb/reconstruct.h>

#include <fmt/format.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <system_error>

namespace bench
{

/// A folder that goes with it.
struct Folder {
    std::filesystem::path path =
        std::filesystem::temp_directory_path() / fmt::format("mpuvdb_bench.{}", ::getpid());

    Folder() { std::filesystem::create_directory(path); }
    ~Folder()
    {
        std::error_code ignored;
        std::filesystem::remove_all(path, ignored);
    }
    Folder(const Folder&) = delete;
    Folder& operator=(const Folder&) = delete;
};

/// Ours, by default settings but for the @a voxels along the longest side.
inline mpuvdb::Mesh ourMesh(const mpuvdb::PointCloud& cloud, int voxels,
                            mpuvdb::Interrupter& progress)
{
    mpuvdb::ReconstructOptions settings;
    settings.voxels = voxels;
    return mpuvdb::extractMesh(
        mpuvdb::reconstruct(mpuvdb::PointCloud(cloud), settings, &progress).levelSet(), {},
        &progress);
}

/// PoissonRecon's mesh of @a cloud. @param program  its path.
inline mpuvdb::Mesh poissonMesh(const std::string& program, int depth,
                                const mpuvdb::PointCloud& cloud, mpuvdb::Interrupter& progress)
{
    const Folder folder;
    const auto points = folder.path / "points.ply", made = folder.path / "mesh.ply";
    mpuvdb::writePoints(points, cloud, &progress);
    const std::string command = fmt::format("'{}' --in '{}' --out '{}' --depth {} > /dev/null 2>&1",
                                            program, points.string(), made.string(), depth);
    if (std::system(command.c_str()) != 0) throw std::runtime_error(command + ": failed");
    return mpuvdb::readMesh(made, &progress);
}

} // namespace bench
