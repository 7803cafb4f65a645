// Comparison of level sets with the input that they were made from.
#pragma once
#include <mpuvdb/level_set.h>
#include <mpuvdb/mpu_field.h>

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace mpuvdb
{

/// What the repair of a broken mesh did. Lengths and areas are in world units.
struct MeshRepair {
    std::uint64_t dropped = 0; ///< triangles with vertices that are not finite or not there
    std::uint64_t copies = 0;  ///< triangles left out for others with the same corners
    std::uint64_t turned = 0;  ///< whole patches of the surface that were turned to face outward
    std::uint64_t holes = 0;   ///< surfaces that close holes
    double holesArea = 0;      ///< of these surfaces together
    double widestHole = 0;     ///< diagonal of the box of the largest of them
    Vec3d widestHoleAt = Vec3d::Zero(); ///< middle of that box
    std::uint64_t innerWalls = 0;       ///< open surfaces within the solid, left out
    std::uint64_t sheets = 0;           ///< open surfaces that were made walls
    double sheetsArea = 0;              ///< of these
};

/// Comparison of a mesh with the level set of its solid.
struct MeshExplained {
    /// Volumes of the mesh's solid and of the level set's, world units cubed. Holes of the mesh
    /// count as if cones over their rims closed them; where repair closed them otherwise, the two
    /// are not compared.
    double volumeIn = 0, volumeOut = 0;
    double areaIn = 0, areaOut = 0; ///< of their boundaries, world units squared
    std::uint64_t partsIn = 0;      ///< surfaces that enclose parts of the mesh's solid
    std::uint64_t partsOut = 0;     ///< connected parts of the level set's solid
    std::uint64_t cavitiesIn = 0;   ///< surfaces that enclose cavities of the mesh's solid
    std::uint64_t cavitiesOut = 0;  ///< connected cavities of the level set's solid
    /// The difference of the volumes that the voxel size h explains, world units cubed: h^2 / 4
    /// times the integral of the surface's curvatures (over a mesh the sum of edge lengths times
    /// angles between normals). Half of it is the error of linear interpolation, half that of the
    /// sum over voxels beside edges. At most 3/16 of the volume: the error for a ball four voxels
    /// across, the smallest that a band resolves. And what the mesh's holes and gaps, smaller than
    /// a voxel, add to the volume of its faces.
    double volumeExplained = 0;
    /// Share of the mesh's boundary around which all eight voxels are on one side, in [0, 1].
    double missed = 0;
    std::uint64_t openEdges = 0;      ///< edges of the mesh whose triangles do not cancel
    std::uint64_t turned = 0;         ///< triangles turned to face as their neighbors do
    bool insideOut = false;           ///< all parts faced inward, and were turned
    double areaWithin = 0;            ///< of triangles inside the solid, world units squared
    double areaOfNothing = 0;         ///< of parts that face inward and lie in no other, the same
    std::optional<MeshRepair> repair; ///< if repair was asked for
    std::vector<std::string>
        findings; ///< deviations that the voxel size does not explain, and cures
};

/// Comparison of points with the level set made of them.
struct PointsExplained {
    std::uint64_t points = 0; ///< fitted points in the region
    double limit = 0;   ///< distance up to which the surface explains a point, world units: half a
                        ///< voxel, the tolerance, and three standard deviations of the noise
    double within = 1;  ///< share of the points within the limit, in [0, 1]
    double largest = 0; ///< largest distance of a point, world units; at most the band's half-width
    std::uint64_t beyondBand = 0; ///< points that are that far away, or farther
    /// Share of the points whose normals are more than 60 degrees off the surface's, in [0, 1].
    double against = 0;
    /// Share of the surface without a point within five spacings of its block of 8 x 8 x 8 voxels.
    double unsupported = 0;
    double volume = 0, area = 0; ///< of the level set's solid, world units cubed and squared
    std::uint64_t parts = 0;     ///< connected parts of the level set's solid
    std::uint64_t cavities = 0;  ///< connected cavities of the level set's solid
    /// The mesh whose vertices the points are, if they are; without its places.
    std::optional<VertexMesh> mesh;
    double meshWithin = 1; ///< share of that mesh's area near the surface: limit and half a spacing
    std::vector<std::string>
        findings; ///< deviations that noise, spacing and voxel size do not explain
};

/// The comparison of a level set with its input.
struct Explained {
    std::variant<MeshExplained, PointsExplained> by;

    const std::vector<std::string>& findings() const
    {
        return std::visit(
            [](const auto& e) -> const auto& { return e.findings; }, by);
    }
    bool isSound() const { return findings().empty(); }
};

/// Compare @a levelSet, sampled from @a field, with the field's points. @param region  box (world
/// units), if only a part was sampled. The same for any number of threads. @throws Interrupted.
PointsExplained explain(const LevelSet& levelSet, const MpuField& field,
                        const std::optional<Box3d>& region, Interrupter* interrupter = nullptr);

/// The comparison of a whole by those of its parts, with the number of active voxels of each. What
/// only the whole has is not known: volume, area, parts, cavities, the mesh.
PointsExplained joinExplained(const std::vector<std::pair<PointsExplained, std::uint64_t>>& parts,
                              const PointStatistics& points, double voxelSize);

} // namespace mpuvdb
