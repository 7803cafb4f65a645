// Library values as JSON with the report's keys.
#pragma once
#include <mpuvdb/explained.h>
#include <mpuvdb/io.h>
#include <mpuvdb/mesh.h>
#include <mpuvdb/vec.h>

#include <nlohmann/json.hpp>

namespace mpuvdb::command
{

using Json = nlohmann::ordered_json;

/// What voxelize() found when it held the level set against the mesh.
Json toJson(const MeshExplained& explained);

/// The same in a line.
std::string explainedText(const MeshExplained& explained);

/// What reconstruct() found when it held the level set against the points.
Json toJson(const PointsExplained& explained);

/// The same in a line.
std::string explainedText(const PointsExplained& explained);

Json toJson(const Vec3d& v);
Json toJson(const MeshReport& mesh);
Json toJson(const Distances& distances);
/// Name, voxel size, half-width, active voxels and bytes in memory.
Json toJson(const LevelSet& levelSet);
/// What check() measured and found.
Json toJson(const CheckReport& report);

/// "12 not finite, 3 zero normal".
std::string droppedText(const std::map<std::string, std::uint64_t>& dropped);
/// One line per finding, with its voxel.
std::string findingText(const CheckFinding& finding);

} // namespace mpuvdb::command
