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
    Json json = {{"volume_in", e.volumeIn},
                 {"volume_out", e.volumeOut},
                 {"volume_explained", e.volumeExplained},
                 {"area_in", e.areaIn},
                 {"area_out", e.areaOut},
                 {"parts_in", e.partsIn},
                 {"parts_out", e.partsOut},
                 {"cavities_in", e.cavitiesIn},
                 {"cavities_out", e.cavitiesOut},
                 {"missed", e.missed},
                 {"area_within", e.areaWithin},
                 {"area_of_nothing", e.areaOfNothing},
                 {"open_edges", e.openEdges},
                 {"turned", e.turned},
                 {"inside_out", e.insideOut},
                 {"findings", e.findings},
                 {"sound", e.findings.empty()}};
    if (!e.repair) return json;
    const MeshRepair& r = *e.repair;
    json["repair"] = {{"dropped", r.dropped},
                      {"copies", r.copies},
                      {"patches_turned", r.turned},
                      {"holes", r.holes},
                      {"holes_area", r.holesArea},
                      {"widest_hole", r.widestHole},
                      {"widest_hole_at", toJson(r.widestHoleAt)},
                      {"inner_walls", r.innerWalls},
                      {"sheets", r.sheets},
                      {"sheets_area", r.sheetsArea}};
    return json;
}

std::vector<std::string> repairText(const MeshExplained& explained)
{
    const MeshRepair& r = *explained.repair;
    std::vector<std::string> lines;
    if (r.dropped > 0)
        lines.push_back(fmt::format("{} triangles with vertices that are not finite, or not "
                                    "there, were left out",
                                    r.dropped));
    if (r.copies > 0)
        lines.push_back(fmt::format("{} copies of triangles were left out", r.copies));
    if (r.turned > 0) lines.push_back(fmt::format("{} patches were turned outward", r.turned));
    if (r.holes > 0)
        lines.push_back(fmt::format("{} holes were closed, {:.4g} of area; the widest, {:.4g}, is "
                                    "near ({:.6g}, {:.6g}, {:.6g})",
                                    r.holes, r.holesArea, r.widestHole, r.widestHoleAt[0],
                                    r.widestHoleAt[1], r.widestHoleAt[2]));
    if (r.innerWalls > 0)
        lines.push_back(
            fmt::format("{} open surfaces within the solid were left out", r.innerWalls));
    if (r.sheets > 0)
        lines.push_back(
            fmt::format("{} open surfaces of area {:.4g} were made walls", r.sheets, r.sheetsArea));
    if (lines.empty() && explained.turned == 0) lines.push_back("nothing was broken");
    return lines;
}

std::string explainedText(const MeshExplained& explained)
{
    const MeshExplained& e = explained;
    return fmt::format(
        "volume {:.6g} of {:.6g} (voxels explain {:.2g}), parts {} of {}, {:.3g} % of "
        "the surface missed",
        e.volumeOut, e.volumeIn, e.volumeExplained, e.partsOut, e.partsIn, 100 * e.missed);
}

Json toJson(const PointsExplained& explained)
{
    const PointsExplained& e = explained;
    Json json = {{"points", e.points},
                 {"limit", e.limit},
                 {"within", e.within},
                 {"largest", e.largest},
                 {"beyond_band", e.beyondBand},
                 {"against", e.against},
                 {"unsupported", e.unsupported},
                 {"volume", e.volume},
                 {"area", e.area},
                 {"parts", e.parts},
                 {"cavities", e.cavities}};
    if (e.mesh)
        json["mesh"] = {{"area", e.mesh->area},         {"volume", e.mesh->volume},
                        {"closed", e.mesh->isClosed},   {"parts", e.mesh->parts},
                        {"cavities", e.mesh->cavities}, {"within", e.meshWithin}};
    json["findings"] = e.findings;
    json["sound"] = e.findings.empty();
    return json;
}

std::string farthestText(const PointsExplained& explained)
{
    return fmt::format("{}{:.3g}", explained.beyondBand ? "at least " : "", explained.largest);
}

std::string explainedText(const PointsExplained& explained)
{
    const PointsExplained& e = explained;
    if (e.points == 0) return "no point lies in the region";
    const std::string ofMesh =
        e.mesh ? fmt::format(", {:.4g} % of the mesh", 100 * e.meshWithin) : "";
    return fmt::format(
        "{:.4g} % of the points{} within {:.3g} of the surface, the farthest {}; "
        "the normals of {:.2g} % look elsewhere; {:.2g} % of it is far from any; parts {}",
        100 * e.within, ofMesh, e.limit, farthestText(e), 100 * e.against, 100 * e.unsupported,
        e.parts);
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
    if (finding.count == 0) return finding.what; // of the grid as a whole
    const openvdb::Coord& v = finding.voxel;
    return fmt::format("{} (voxel {}, {}, {}; {} in all)", finding.what, v.x(), v.y(), v.z(),
                       finding.count);
}

} // namespace mpuvdb::command
