// One writer per mesh format. All throw LimitError for more than their format can hold, before the
// first byte.
#pragma once
#include "files/output_stream.h"
#include "io/for_each_item.h"
#include <mpuvdb/interrupter.h>
#include <mpuvdb/io.h>

#include <string>

namespace mpuvdb
{

/// The input of a writer; attributes are valid.
struct MeshJob {
    const Mesh& mesh;
    const SceneSettings& scene;
    const std::string name; ///< of the file, for messages
    Interrupter& progress;
};

void writePly(const MeshJob& job, OutputBuffer& out);
void writeObj(const MeshJob& job, OutputBuffer& out);
void writeOff(const MeshJob& job, OutputBuffer& out);
void writeStl(const MeshJob& job, OutputBuffer& out);
void writeGlb(const MeshJob& job, OutputBuffer& out);
void writeUsda(const MeshJob& job, OutputBuffer& out);

/// Whether floats of world coordinates have more than three bits less than the mesh's own.
bool needsDoubles(const Mesh& mesh);

/// @throws UsageError for settings out of range.
void requireScene(const SceneSettings& scene);

/// The sizes of the arrays in a GLB file's binary part, bytes.
struct GlbSizes {
    std::uint64_t indices, positions, colors, scalars; ///< scalars: each of them

    GlbSizes(std::uint64_t triangles, std::uint64_t vertices);
};

/// @throws LimitError where a .glb file of @a binary and @a json bytes would be over 4 GiB.
void requireGlbFits(std::uint64_t binary, std::uint64_t json, const std::string& name);

} // namespace mpuvdb
