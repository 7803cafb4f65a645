// Particles from points, in memory or read.
#include <mpuvdb/particles.h>

#include "files/text_scan.h"
#include <mpuvdb/error.h>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <optional>

namespace mpuvdb
{
namespace
{

/// Scalars by which importParticles() hands radii and velocities through the door of points.
const ParticleNames& namesInside()
{
    static const ParticleNames names{" radius", 1, {" vx", " vy", " vz"}};
    return names;
}

/// Moves the scalars called @a name out of @a points; empty if there are none.
std::vector<float> take(PointInput& points, const std::string& name)
{
    std::vector<NamedScalars>& all = points.cloud.scalars;
    const auto found =
        std::find_if(all.begin(), all.end(), [&](const NamedScalars& s) { return s.name == name; });
    if (name.empty() || found == all.end()) return {};
    std::vector<float> values = std::move(found->values);
    all.erase(found);
    return values;
}

/// What names of a vector's components add to its own: of our files, and as Houdini, ParaView and
/// others write them.
constexpr const char* kComponents[][3] = {
    {"x", "y", "z"},    {"_x", "_y", "_z"}, {".x", ".y", ".z"},    {":x", ":y", ":z"},
    {"_0", "_1", "_2"}, {":0", ":1", ":2"}, {"[0]", "[1]", "[2]"}, {"[x]", "[y]", "[z]"}};

/// That of @a scalars which is @a name but for capitals.
std::optional<std::string> named(const std::vector<std::string>& scalars, const std::string& name)
{
    for (const std::string& scalar : scalars)
        if (lowerCase(scalar) == name) return scalar;
    return {};
}

} // namespace

ParticleNames ParticleNames::among(const std::vector<std::string>& scalars)
{
    ParticleNames names;
    for (const auto& [name, scale] :
         {std::pair("pscale", 1.0), std::pair("radius", 1.0), std::pair("width", 0.5),
          std::pair("widths", 0.5), std::pair("diameter", 0.5)})
        if (const auto found = named(scalars, name); found && names.radius.empty()) {
            names.radius = *found;
            names.radiusScale = scale;
        }
    for (const char* const vector : {"v", "vel", "velocity", "velocities"})
        for (const auto& ends : kComponents) {
            std::vector<std::string> parts;
            for (const char* const end : ends) {
                const auto found = named(scalars, std::string(vector) + end);
                if (!found) break;
                parts.push_back(*found);
            }
            const bool isVector = parts.size() > 1; // of two: a simulation in a plane
            if (isVector && parts.size() > names.velocity.size()) names.velocity = std::move(parts);
        }
    return names;
}

Particles particlesOf(PointInput&& points, const ParticleNames& names)
{
    Particles particles;
    particles.radii = take(points, names.radius);
    if (names.radiusScale != 1)
        for (float& r : particles.radii) r = float(names.radiusScale * double(r));
    for (std::size_t axis = 0; axis < names.velocity.size(); ++axis) {
        const std::vector<float> part = take(points, names.velocity[axis]);
        particles.velocities.resize(part.size(), Vec3f::Zero());
        for (std::size_t i = 0; i < part.size(); ++i)
            particles.velocities[i][Eigen::Index(axis)] = part[i];
    }
    if (names.velocity.size() == 2 && !particles.velocities.empty())
        points.notes.push_back(fmt::format("velocities have two components, {} and {}: the third "
                                           "is 0",
                                           names.velocity[0], names.velocity[1]));
    particles.frame = points.cloud.frame;
    particles.positions = std::move(points.cloud.positions);
    particles.colors = std::move(points.cloud.colors);
    particles.scalars = std::move(points.cloud.scalars);
    particles.dropped = std::move(points.dropped);
    particles.notes = std::move(points.notes);
    particles.warnings = std::move(points.warnings);
    return particles;
}

Particles importParticles(const ParticleView& view, Interrupter* interrupter)
{
    const ParticleNames& names = namesInside();
    if (view.velocities.rows != view.positions.rows && !view.velocities.empty())
        throw UsageError(fmt::format("particles: {} velocities for {} particles. Give one for "
                                     "each, or none",
                                     view.velocities.rows, view.positions.rows));
    PointView points;
    points.positions = view.positions;
    points.colors = view.colors;
    points.scalars = view.scalars;
    if (!view.radii.empty()) points.scalars.emplace_back(names.radius, view.radii);
    for (std::size_t axis = 0; axis < 3 && !view.velocities.empty(); ++axis) {
        NumberView part = view.velocities;
        const std::size_t size = part.type == NumberView::Type::Double  ? sizeof(double)
                                 : part.type == NumberView::Type::Float ? sizeof(float)
                                                                        : 1;
        part.columns = 1;
        part.first = static_cast<const std::byte*>(part.first) + axis * size;
        points.scalars.emplace_back(names.velocity[axis], part);
    }
    return particlesOf(importPoints(points, "particles", BadPoints::Drop, interrupter), names);
}

} // namespace mpuvdb
