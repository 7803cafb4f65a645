// What was made, held against what it was made from.
#pragma once
#include <mpuvdb/level_set.h>
#include <mpuvdb/mpu_field.h>

#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace mpuvdb
{

/// A mesh and the level set of its solid, compared.
struct MeshExplained {
    double volumeIn = 0, volumeOut = 0; ///< of the mesh's solid and of the level set's, world units
                                        ///< cubed
    double areaIn = 0, areaOut = 0;     ///< of their boundaries, world units squared
    std::uint64_t partsIn = 0;          ///< surfaces that enclose some of the mesh's solid
    std::uint64_t partsOut = 0;         ///< connected parts of the level set's solid
    std::uint64_t cavitiesIn = 0;       ///< surfaces that enclose what is none of the mesh's solid
    std::uint64_t cavitiesOut = 0;      ///< connected parts of what the level set's solid encloses
    /// The difference of the volumes that the voxel size explains: h^2 / 4 times the integral of
    /// the surface's curvatures, which over a mesh is the sum of its edges' lengths times the
    /// angles between normals. Half of it is what values that are linear between voxels move a
    /// surface by, the other half what the volume's sum over voxels errs by beside edges. At most
    /// 3/16 of the volume: what linear values take of a ball four voxels across, the smallest that
    /// a band resolves.
    double volumeExplained = 0;
    /// Share of the mesh's boundary around which all eight voxels are on one side.
    double missed = 0;
    std::uint64_t openEdges = 0;       ///< edges of the mesh whose triangles do not cancel
    std::uint64_t turned = 0;          ///< triangles that faced another way than their neighbors
    bool insideOut = false;            ///< all parts faced inward, and were turned
    double areaWithin = 0;             ///< of triangles inside the solid, world units squared
    double areaOfNothing = 0;          ///< of parts that face inward and lie in no other
    std::vector<std::string> findings; ///< what the voxel size does not explain, with the cure
};

/// Points and the level set made of them, compared.
struct PointsExplained {
    std::uint64_t points = 0; ///< those that were fitted, in the region
    double limit = 0;   ///< world units: so near to the surface a point is explained by it: half a
                        ///< voxel, the tolerance, and three standard deviations of the noise
    double within = 1;  ///< share of the points that are explained
    double largest = 0; ///< world units: the largest distance, if it is in the band, else its width
    /// Share of the points whose normals look against the surface's.
    double against = 0;
    /// Share of the surface in whose blocks of eight voxels and within five spacings of them there
    /// is no point.
    double unsupported = 0;
    double volume = 0, area = 0; ///< of the level set's solid, world units cubed and squared
    std::uint64_t parts = 0;     ///< of the level set's solid, that are connected
    std::uint64_t cavities = 0;  ///< connected parts of what it encloses
    /// The mesh whose vertices the points are, if they are; without its places.
    std::optional<VertexMesh> mesh;
    double meshWithin =
        1; ///< share of that mesh's area that is as near to the surface as the limit
    std::vector<std::string> findings; ///< what noise, spacing and voxel size do not explain
};

/// What a level set was held against when it was made.
struct Explained {
    std::variant<MeshExplained, PointsExplained> by;

    const std::vector<std::string>& findings() const
    {
        return std::visit(
            [](const auto& e) -> const auto& { return e.findings; }, by);
    }
    bool isSound() const { return findings().empty(); }
};

/// Hold @a levelSet, sampled from @a field, against the field's points. @param region  of the
/// world, if only a part was sampled. The same for any number of threads. @throws Interrupted.
PointsExplained explain(const LevelSet& levelSet, const MpuField& field,
                        const std::optional<Box3d>& region, Interrupter* interrupter = nullptr);

} // namespace mpuvdb
