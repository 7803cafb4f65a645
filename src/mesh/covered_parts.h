// The vertices of a mesh that trimming keeps, decided part by part.
#pragma once
#include <mpuvdb/mesh.h>

#include <vector>

namespace mpuvdb
{

class Interrupter;

/// Averages @a values with those of the neighbors along edges, a few times.
void smoothOverEdges(const Mesh& mesh, std::vector<float>& values, Interrupter& progress);

/// Flips the sign of @a values (0 and above: covered) on uncovered patches that are small enough to
/// stay closed, and then on covered parts that are islands in a hole.
void decideParts(const Mesh& mesh, const TrimSettings& settings, std::vector<float>& values,
                 TrimReport& report, Interrupter& progress);

} // namespace mpuvdb
