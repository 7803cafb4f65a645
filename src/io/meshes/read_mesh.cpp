// Meshes, by the readers of points, which also read faces.
#include "io/points/readers.h"
#include "io/points/surplus.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/io.h>

#include <fmt/format.h>

#include <limits>

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

} // namespace

Mesh readMesh(const std::filesystem::path& file, Interrupter* interrupter, BadVertices bad)
{
    Interrupter& progress = orSilent(interrupter);
    std::error_code error;
    const auto bytes = std::filesystem::file_size(file, error);
    progress.beginStage("read", error ? 1 : double(bytes));
    FilePoints points = readFormat(file, {}, progress);
    if (points.triangles.empty())
        throw InputError(
            fmt::format("{}: has no triangles{}. Name a mesh (.ply, .obj, .off, .stl), "
                        "or reconstruct a surface from its points.",
                        points.name, butNotes(points)));
    for (const std::string& note : points.notes) progress.note(points.name + ": " + note);
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
    for (Mesh::Triangle& triangle : mesh.triangles)
        for (std::uint32_t& corner : triangle) corner = numbers[corner];
    progress.endStage();
    return mesh;
}

} // namespace mpuvdb
