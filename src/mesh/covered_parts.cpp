#include "covered_parts.h"

#include "cut_mesh.h"

#include "core/union_find.h"
#include <mpuvdb/interrupter.h>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <numeric>
#include <unordered_map>

namespace mpuvdb
{
namespace
{

/// The number of averages over neighbors. [tuned: coverage_test]
constexpr int kSmoothings = 12;

/// Calls f(from, to) for each side of each triangle.
template <typename F>
void forEachSide(const Mesh& mesh, const Interrupter& progress, F f)
{
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
        if (t % kCheckStride == 0) progress.check();
        const Mesh::Triangle& v = mesh.triangles[t];
        for (std::size_t side = 0; side < 3; ++side) f(v[side], v[(side + 1) % 3]);
    }
}

/// Each vertex's part, connected by edges between vertices of one sign.
std::vector<std::uint32_t> partsOf(const Mesh& mesh, const std::vector<float>& values,
                                   const Interrupter& progress)
{
    UnionFind parts(mesh.positions.size());
    forEachSide(mesh, progress, [&](std::uint32_t a, std::uint32_t b) {
        if (isCovered(values[a]) == isCovered(values[b])) parts.join(a, b);
    });
    return parts.roots();
}

/// One connected part of a sign.
struct Part {
    std::vector<Vec3f> places; ///< vertices, and crossings of edges at the rim
    bool hasRim = false;
};

/// The largest distance between two of @a places, by going from each to the farthest until it grows
/// no more.
double extentOf(const std::vector<Vec3f>& places)
{
    Vec3f from = places.front();
    float extent2 = 0;
    for (bool grew = true; grew;) {
        grew = false;
        Vec3f farthest = from;
        for (const Vec3f& p : places) {
            const float d2 = (p - from).squaredNorm();
            if (!(d2 > extent2)) continue;
            extent2 = d2;
            farthest = p;
            grew = true;
        }
        from = farthest;
    }
    return std::sqrt(double(extent2));
}

/// The parts of one sign, by root.
std::unordered_map<std::uint32_t, Part> gatherParts(const Mesh& mesh,
                                                    const std::vector<float>& values,
                                                    const std::vector<std::uint32_t>& parts,
                                                    bool covered, const Interrupter& progress)
{
    std::unordered_map<std::uint32_t, Part> gathered;
    std::vector<char> used(mesh.positions.size(), 0);
    const auto take = [&](std::uint32_t v) {
        if (used[v]) return;
        used[v] = 1;
        gathered[parts[v]].places.push_back(mesh.positions[v]);
    };
    forEachSide(mesh, progress, [&](std::uint32_t a, std::uint32_t b) {
        if (isCovered(values[a]) != covered) return;
        take(a);
        if (isCovered(values[b]) == covered) return;
        Part& part = gathered[parts[a]];
        part.hasRim = true;
        const float t = crossing(values[a], values[b]);
        part.places.push_back(mesh.positions[a] + t * (mesh.positions[b] - mesh.positions[a]));
    });
    return gathered;
}

} // namespace

void smoothOverEdges(const Mesh& mesh, std::vector<float>& values, Interrupter& progress)
{
    std::vector<std::uint32_t> start(mesh.positions.size() + 1, 0);
    forEachSide(mesh, progress, [&](std::uint32_t from, std::uint32_t) { ++start[from + 1]; });
    std::partial_sum(start.begin(), start.end(), start.begin());
    std::vector<std::uint32_t> neighbor(start.back()), next(start.begin(), start.end() - 1);
    forEachSide(mesh, progress,
                [&](std::uint32_t from, std::uint32_t to) { neighbor[next[from]++] = to; });
    std::vector<float> smooth(values.size());
    for (int n = 0; n < kSmoothings; ++n) {
        progress.check();
        tbb::parallel_for(tbb::blocked_range<std::size_t>(0, values.size(), 4096),
                          [&](const tbb::blocked_range<std::size_t>& range) {
                              for (std::size_t v = range.begin(); v < range.end(); ++v) {
                                  float sum = 0;
                                  for (std::uint32_t i = start[v]; i < start[v + 1]; ++i)
                                      sum += values[neighbor[i]];
                                  const auto count = float(start[v + 1] - start[v]);
                                  smooth[v] = count > 0 ? (values[v] + sum / count) / 2 : values[v];
                              }
                          });
        values.swap(smooth);
    }
}

void decideParts(const Mesh& mesh, const TrimSettings& settings, std::vector<float>& values,
                 TrimReport& report, Interrupter& progress)
{
    for (const bool covered : {false, true}) {
        const std::vector<std::uint32_t> parts = partsOf(mesh, values, progress);
        auto gathered = gatherParts(mesh, values, parts, covered, progress);
        const double limit = covered ? settings.islands : settings.closeUpTo;
        std::vector<char> turned(mesh.positions.size(), 0); // by root
        for (const auto& [root, part] : gathered) {
            const bool turn = part.hasRim && extentOf(part.places) <= limit;
            turned[root] = turn;
            if (turn) ++(covered ? report.islands : report.closed);
        }
        for (std::uint32_t v = 0; v < values.size(); ++v)
            if (isCovered(values[v]) == covered && turned[parts[v]])
                values[v] = covered ? -0.5f : 0.5f;
    }
    const std::vector<std::uint32_t> parts = partsOf(mesh, values, progress);
    report.open = 0;
    for (const auto& [root, part] : gatherParts(mesh, values, parts, false, progress))
        report.open += part.hasRim;
}

} // namespace mpuvdb
