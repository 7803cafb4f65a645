// Metadata of grids that were reconstructed.
#include <mpuvdb/reconstruct.h>

#include <fmt/format.h>

namespace mpuvdb
{

std::map<std::string, std::string> metadataOf(const ReconstructReport& report)
{
    const ResolvedSettings& s = report.settings;
    const auto text = [](const auto& value) { return fmt::format("{}", value); };
    std::map<std::string, std::string> result = {
        {"mpuvdb:version", MPUVDB_VERSION},
        {"mpuvdb:points", text(report.points)},
        {"mpuvdb:spacing", text(s.points.spacing)},
        {"mpuvdb:noise", text(s.points.noise)},
        {"mpuvdb:voxel_size", text(s.grid.lattice.voxelSize)},
        {"mpuvdb:half_width", text(s.grid.halfWidth)},
        {"mpuvdb:tolerance", text(s.fit.tolerance)},
        {"mpuvdb:alpha", text(s.fit.alpha)},
        {"mpuvdb:min_points", text(s.fit.minPoints)},
        {"mpuvdb:sharp", text(s.fit.sharp)}};
    if (report.fit.leaves > 0) result["mpuvdb:max_error"] = text(report.fit.maxError);
    if (s.fit.interpolate) result["mpuvdb:interpolate"] = text(true);
    if (s.grid.region) {
        const Vec3d &a = s.grid.region->min(), &b = s.grid.region->max();
        result["mpuvdb:region"] =
            fmt::format("{} {} {} {} {} {}", a.x(), a.y(), a.z(), b.x(), b.y(), b.z());
    }
    return result;
}

} // namespace mpuvdb
