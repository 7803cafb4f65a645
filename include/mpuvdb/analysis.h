// What a level set's surface is like, as grids; and how far surfaces are apart.
#pragma once
#include <mpuvdb/level_set.h>
#include <mpuvdb/point_cloud.h>
#include <mpuvdb/triangle_mesh.h>

#include <string>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// What analyze() computes.
struct AnalyzeSettings {
    /// "normals": unit, outward (Vec3f); "curvature": the mean of the principal curvatures, 1 /
    /// world units, positive where convex; "thickness": diameter of the largest ball inside that
    /// touches the surface there, world units.
    bool normals = true, curvature = true, thickness = true;
};

/// Grids on the active voxels of @a levelSet, on its lattice, by name; each voxel has the value of
/// its nearest place on the surface, so that they are as useful there as on meshes
/// (addAttribute()). Curvature is by second differences (OpenVDB's meanCurvature()): of a radius of
/// r voxels it errs by some 5 / r^2 of itself, and at creases it is only large. The
/// same for any number of threads. @throws Interrupted.
openvdb::GridCPtrVec analyze(const LevelSet& levelSet, const AnalyzeSettings& settings = {},
                             Interrupter* interrupter = nullptr);

/// For each vertex of @a mesh its distance to @a reference, world units: positive on the side where
/// its triangles face. @throws UsageError (@a reference has no triangles), Interrupted.
std::vector<float> deviation(const Mesh& mesh, const Mesh& reference,
                             Interrupter* interrupter = nullptr);
/// The same to the nearest of some points; not signed. @throws UsageError (no points).
std::vector<float> deviation(const Mesh& mesh, const PointCloud& reference,
                             Interrupter* interrupter = nullptr);

} // namespace mpuvdb
