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

/// voxelize()'s comparison of the level set with the mesh.
Json toJson(const MeshExplained& explained);

/// The comparison in a line.
std::string explainedText(const MeshExplained& explained);

/// What was repaired of a mesh that repair looked at, a line for each kind; "nothing" if it was
/// sound.
std::vector<std::string> repairText(const MeshExplained& explained);

/// reconstruct()'s comparison of the level set with the points.
Json toJson(const PointsExplained& explained);

/// The largest distance of a point; "at least" where points lie beyond the band.
std::string farthestText(const PointsExplained& explained);

/// The comparison in a line.
std::string explainedText(const PointsExplained& explained);

Json toJson(const Vec3d& v);
Json toJson(const MeshReport& mesh);
Json toJson(const Distances& distances);
/// Name, voxel size, half-width, active voxels and bytes in memory.
Json toJson(const LevelSet& levelSet);
/// The measurements and findings of check().
Json toJson(const CheckReport& report);

/// "12 not finite, 3 zero normal".
std::string droppedText(const std::map<std::string, std::uint64_t>& dropped);
/// One line per finding, with its voxel.
std::string findingText(const CheckFinding& finding);

} // namespace mpuvdb::command
