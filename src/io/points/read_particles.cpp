// Particles of files.
#include "files/text_scan.h"
#include "io/vdb/point_grids.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/io.h>

#include <algorithm>
#include <fmt/format.h>

namespace mpuvdb
{
namespace
{

/// Warn of radii and velocities that only some files have.
void noteIgnored(const ParticleNames& names, PointInput& points)
{
    std::vector<std::string> partial;
    for (const auto& [name, file] : points.partialScalars) partial.push_back(name);
    const ParticleNames some = ParticleNames::among(partial);
    const auto warn = [&](const std::string& name, const char* what) {
        points.warnings.push_back(fmt::format("{} has no '{}': the {} of the other inputs are "
                                              "ignored",
                                              points.partialScalars.at(name), name, what));
    };
    if (names.radius.empty() && !some.radius.empty()) warn(some.radius, "radii");
    if (names.velocity.empty() && !some.velocity.empty()) warn(some.velocity.front(), "velocities");
}

} // namespace

Particles readParticles(const std::vector<std::filesystem::path>& files,
                        const std::vector<std::string>& scalars, std::uint64_t maxBytes,
                        Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    const auto isVdb = [](const std::filesystem::path& file) {
        return lowerCase(file.extension().string()) == ".vdb";
    };
    if (std::any_of(files.begin(), files.end(), isVdb)) {
        if (files.size() > 1)
            throw UsageError("a .vdb file of points is read alone: leave out the other inputs");
        progress.beginStage("read");
        return readPointGrids(files.front(), scalars, maxBytes, progress);
    }
    // What a file has is known once it was read: its numbers are read where there are some.
    PointInput points = readPoints(files, BadPoints::Drop, {}, {}, &progress);
    const ParticleNames names = ParticleNames::among(points.scalarNames);
    std::vector<std::string> wanted = scalars;
    const auto add = [&](const std::string& name) {
        if (!name.empty() && std::find(wanted.begin(), wanted.end(), name) == wanted.end())
            wanted.push_back(name);
    };
    add(names.radius);
    for (const std::string& name : names.velocity) add(name);
    if (!wanted.empty()) points = readPoints(files, BadPoints::Drop, {}, wanted, &progress);
    noteIgnored(names, points);
    return particlesOf(std::move(points), names);
}

} // namespace mpuvdb
