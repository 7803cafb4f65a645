#include "active_value.h"

#include <mpuvdb/interrupter.h>
#include <mpuvdb/mesh.h>
#include <mpuvdb/normals.h>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

constexpr std::size_t kVerticesAtOnce = 4096; ///< in a task [free: grain size]

template <class F>
void forEachBlock(std::size_t vertices, Interrupter& progress, const F& f)
{
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, vertices, kVerticesAtOnce),
                      [&](const tbb::blocked_range<std::size_t>& range) {
                          progress.check();
                          f(range.begin(), range.end());
                      });
}

/// The values of @a grid at the vertices, converted by @a take.
template <class Grid, class Value, class F>
std::vector<Value> valuesAt(const Mesh& mesh, const Grid& grid, Interrupter& progress,
                            const F& take)
{
    std::vector<Value> values(mesh.positions.size());
    forEachBlock(values.size(), progress, [&](std::size_t begin, std::size_t end) {
        const auto accessor = grid.getConstAccessor();
        for (std::size_t v = begin; v < end; ++v) {
            const Vec3d p = mesh.world(v);
            const openvdb::Vec3d at = grid.worldToIndex({p[0], p[1], p[2]});
            values[v] = take(activeValue(accessor, at));
        }
    });
    return values;
}

} // namespace

void addAttributes(Mesh& mesh, const SurfaceAttributes& attributes, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    const std::vector<Vec3f> normals = vertexNormals(mesh.positions, mesh.triangles);
    const std::size_t channels = attributes.channels(), vertices = mesh.positions.size();
    const std::size_t colors = attributes.hasColors() ? 3 : 0, before = mesh.scalars.size();
    if (colors > 0) mesh.colors.resize(vertices);
    for (const std::string& name : attributes.scalarNames())
        mesh.scalars.push_back({name, std::vector<float>(vertices)});
    forEachBlock(vertices, progress, [&](std::size_t begin, std::size_t end) {
        std::vector<SurfacePlace> places;
        for (std::size_t v = begin; v < end; ++v)
            places.push_back({mesh.world(v), normals[v].cast<double>()});
        std::vector<float> values;
        attributes.evaluate(places, values);
        for (std::size_t v = begin; v < end; ++v) {
            const float* const at = values.data() + (v - begin) * channels;
            if (colors > 0) mesh.colors[v] = Vec3f(at[0], at[1], at[2]);
            for (std::size_t c = colors; c < channels; ++c)
                mesh.scalars[before + c - colors].values[v] = at[c];
        }
    });
}

void addAttribute(Mesh& mesh, const openvdb::GridBase& grid, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    if (const auto* colors = dynamic_cast<const openvdb::Vec3SGrid*>(&grid))
        mesh.colors = valuesAt<openvdb::Vec3SGrid, Vec3f>(
            mesh, *colors, progress,
            [](const openvdb::Vec3s& c) { return Vec3f(c[0], c[1], c[2]); });
    else if (const auto* scalars = dynamic_cast<const openvdb::FloatGrid*>(&grid))
        mesh.scalars.push_back(
            {grid.getName(), valuesAt<openvdb::FloatGrid, float>(
                                 mesh, *scalars, progress, [](float value) { return value; })});
}

} // namespace mpuvdb
