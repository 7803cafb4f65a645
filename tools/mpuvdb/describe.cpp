#include "describe.h"

#include <fmt/format.h>

namespace mpuvdb::command
{

Json toJson(const Vec3d& v)
{
    return {v.x(), v.y(), v.z()};
}

Json toJson(const MeshReport& mesh)
{
    return {{"vertices", mesh.vertices},
            {"triangles", mesh.triangles},
            {"components", mesh.components},
            {"boundary_edges", mesh.boundaryEdges},
            {"boundary_loops", mesh.boundaryLoops},
            {"non_manifold_edges", mesh.nonManifoldEdges},
            {"euler_characteristic", mesh.eulerCharacteristic},
            {"genus", mesh.genus},
            {"area", mesh.area},
            {"volume", mesh.volume},
            {"smallest_angle", mesh.smallestAngle},
            {"first_percentile_angle", mesh.firstPercentileAngle}};
}

Json toJson(const Distances& distances)
{
    return {{"mean", distances.mean}, {"rms", distances.rms}, {"max", distances.max}};
}

Json toJson(const MeshExplained& explained)
{
    const MeshExplained& e = explained;
    return {{"volume_in", e.volumeIn},
            {"volume_out", e.volumeOut},
            {"volume_explained", e.volumeExplained},
            {"area_in", e.areaIn},
            {"area_out", e.areaOut},
            {"parts_in", e.partsIn},
            {"parts_out", e.partsOut},
            {"cavities_in", e.cavitiesIn},
            {"missed", e.missed},
            {"area_within", e.areaWithin},
            {"area_of_nothing", e.areaOfNothing},
            {"open_edges", e.openEdges},
            {"turned", e.turned},
            {"inside_out", e.insideOut},
            {"findings", e.findings},
            {"sound", e.isSound()}};
}

std::string explainedText(const MeshExplained& explained)
{
    const MeshExplained& e = explained;
    return fmt::format(
        "volume {:.6g} of {:.6g} (voxels explain {:.2g}), parts {} of {}, {:.2g} % of "
        "the surface missed",
        e.volumeOut, e.volumeIn, e.volumeExplained, e.partsOut, e.partsIn, 100 * e.missed);
}

Json toJson(const LevelSet& levelSet)
{
    const openvdb::FloatGrid& grid = levelSet.grid();
    return {{"name", grid.getName()},
            {"voxel_size", levelSet.voxelSize()},
            {"half_width", levelSet.halfWidth()},
            {"active_voxels", grid.activeVoxelCount()},
            {"bytes", grid.memUsage()}};
}

Json toJson(const CheckReport& report)
{
    Json findings = Json::array();
    for (const CheckFinding& finding : report.findings) {
        const openvdb::Coord& v = finding.voxel;
        findings.push_back(
            {{"what", finding.what}, {"voxel", {v.x(), v.y(), v.z()}}, {"count", finding.count}});
    }
    return {{"sound", report.sound()},
            {"active_voxels", report.activeVoxels},
            {"mean_gradient_error", report.meanGradientError},
            {"max_gradient_error", report.maxGradientError},
            {"findings", findings}};
}

std::string droppedText(const std::map<std::string, std::uint64_t>& dropped)
{
    std::string text;
    for (const auto& [reason, count] : dropped)
        text += fmt::format("{}{} {}", text.empty() ? "" : ", ", count, reason);
    return text;
}

std::string findingText(const CheckFinding& finding)
{
    const openvdb::Coord& v = finding.voxel;
    return fmt::format("{} (voxel {}, {}, {}; {} in all)", finding.what, v.x(), v.y(), v.z(),
                       finding.count);
}

} // namespace mpuvdb::command
