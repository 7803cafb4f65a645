#include "active_value.h"
#include "covered_parts.h"
#include "cut_mesh.h"

#include <mpuvdb/interrupter.h>
#include <mpuvdb/sampling.h>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

using openvdb::FloatGrid;

/// The coverage at the border of the data. [derived: half of a point's full weight]
constexpr float kHalf = 0.5f;
/// The size of a gap between two points, in spacings of the data. [tuned: coverage_test]
constexpr double kGapScale = 2;
/// The size of an island, in spacings: a disc about a dozen stray points. [tuned: coverage_test]
constexpr double kIslandScale = 12;

/// The coverage less one half at the vertices.
std::vector<float> valuesAt(const Mesh& mesh, const FloatGrid& coverage, Interrupter& progress)
{
    std::vector<float> values(mesh.positions.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, values.size(), 4096),
                      [&](const tbb::blocked_range<std::size_t>& range) {
                          progress.check();
                          const FloatGrid::ConstAccessor grid = coverage.getConstAccessor();
                          for (std::size_t v = range.begin(); v < range.end(); ++v) {
                              const Vec3d p = mesh.world(v);
                              const auto at = coverage.worldToIndex({p[0], p[1], p[2]});
                              values[v] = activeValue(grid, at) - kHalf;
                          }
                      });
    return values;
}

} // namespace

TrimSettings trimSettings(const FloatGrid& coverage, double closeUpTo)
{
    const double scale = coverageScale(coverage);
    return {std::max(closeUpTo, kGapScale * scale), kIslandScale * scale};
}

Mesh trimMesh(Mesh mesh, const FloatGrid& coverage, const TrimSettings& settings,
              TrimReport& report, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    report = {};
    progress.beginStage("trim", 4);
    std::vector<float> values = valuesAt(mesh, coverage, progress);
    progress.advance();
    if (!std::all_of(values.begin(), values.end(), isCovered)) {
        // The border of points is as rough as they are; that of a cut is exact.
        if (coverageScale(coverage) > 0) smoothOverEdges(mesh, values, progress);
        progress.advance();
        decideParts(mesh, settings, values, report, progress);
        progress.advance();
        mesh = cutMesh(std::move(mesh), values, progress);
    }
    progress.endStage();
    return mesh;
}

} // namespace mpuvdb
