// Meshes, by the readers of points, which also read faces.
#include "io/points/readers.h"
#include "io/points/surplus.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/io.h>

#include <fmt/format.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

namespace mpuvdb
{
namespace
{

/// Numbers the vertices that triangles use, in order. @return their number.
std::uint32_t numberUsed(const Triangles& triangles, std::vector<std::uint32_t>& numbers)
{
    constexpr std::uint32_t kUnused = std::numeric_limits<std::uint32_t>::max(); // [derived: max]
    std::vector<std::uint8_t> used(numbers.size(), 0);
    for (const auto& triangle : triangles)
        for (const std::uint32_t corner : triangle) used[corner] = 1;
    std::uint32_t count = 0;
    for (std::size_t i = 0; i < numbers.size(); ++i) numbers[i] = used[i] ? count++ : kUnused;
    return count;
}

/// Moves the scalars called @a names out of @a points, whose points are vertices; those that are
/// not finite become 0, with a note. @throws InputError where one is missing.
std::vector<NamedScalars> takeScalars(FilePoints& points, const ScalarNames& names,
                                      Interrupter& progress)
{
    PointBlock& vertices = points.joined();
    for (std::size_t n = 0; n < names.size(); ++n)
        if (attributeOf(names[n], {}) == Attribute::Confidence) // a mesh's vertices are all sure
            vertices.scalars[n] = vertices.confidence;
    requireScalars(points, names);
    std::vector<NamedScalars> scalars;
    std::uint64_t zeroed = 0;
    for (std::size_t n = 0; n < names.size(); ++n) {
        scalars.push_back({names[n], std::move(vertices.scalars[n])});
        for (float& value : scalars.back().values) {
            if (std::isfinite(value)) continue;
            value = 0;
            ++zeroed;
        }
    }
    if (zeroed > 0)
        progress.note(fmt::format("{}: {} of its vertices' scalars are not finite, and became 0",
                                  points.name, zeroed));
    return scalars;
}

} // namespace

Mesh readMesh(const std::filesystem::path& file, Interrupter* interrupter, BadVertices bad,
              const std::vector<std::string>& scalars)
{
    Interrupter& progress = orSilent(interrupter);
    if (scalars.size() > kMaxScalars)
        throw UsageError(
            fmt::format("{} scalars are too many. Name at most {}", scalars.size(), kMaxScalars));
    std::error_code error;
    const auto bytes = std::filesystem::file_size(file, error);
    progress.beginStage("read", error ? HUGE_VAL : double(bytes));
    FilePoints points = readFormat(file, scalars, progress);
    if (points.triangles.empty())
        throw InputError(
            fmt::format("{}: has no triangles{}. Name a mesh (.ply, .obj, .off, .stl), "
                        "or reconstruct a surface from its points.",
                        points.name, butNotes(points)));
    for (const std::string& note : points.notes) progress.note(points.name + ": " + note);
    const std::vector<NamedScalars> found = takeScalars(points, scalars, progress);
    PointBlock& vertices = points.joined();
    const std::vector<Vec3d> positions = std::move(vertices.positions);
    const std::vector<Rgb> colors = std::move(vertices.colors);
    progress.check();
    std::vector<std::uint32_t> numbers(positions.size());
    Mesh mesh;
    mesh.positions.resize(numberUsed(points.triangles, numbers));
    mesh.triangles = std::move(points.triangles);
    progress.check();
    Box3d box;
    for (std::size_t i = 0; i < positions.size(); ++i) {
        if (numbers[i] >= mesh.positions.size()) continue;
        if (positions[i].allFinite())
            box.extend(positions[i]);
        else if (bad == BadVertices::Refuse)
            throw InputError(fmt::format("{}: vertex {} is not finite, and triangles use it. "
                                         "Export the file again, or remove that vertex.",
                                         points.name, i));
    }
    if (!box.isEmpty()) mesh.frame = 0.5 * box.min() + 0.5 * box.max();
    for (std::size_t i = 0; i < positions.size(); ++i)
        if (numbers[i] < mesh.positions.size())
            mesh.positions[numbers[i]] = (positions[i] - mesh.frame).cast<float>();
    if (!colors.empty()) mesh.colors.resize(mesh.positions.size());
    for (std::size_t i = 0; i < colors.size(); ++i)
        if (numbers[i] < mesh.positions.size()) mesh.colors[numbers[i]] = linearColor(colors[i]);
    for (const NamedScalars& some : found) {
        mesh.scalars.push_back({some.name, std::vector<float>(mesh.positions.size())});
        for (std::size_t i = 0; i < some.values.size(); ++i)
            if (numbers[i] < mesh.positions.size())
                mesh.scalars.back().values[numbers[i]] = some.values[i];
    }
    for (Mesh::Triangle& triangle : mesh.triangles)
        for (std::uint32_t& corner : triangle) corner = numbers[corner];
    progress.endStage();
    return mesh;
}

} // namespace mpuvdb
