// What was made, held against what it was made from.
#pragma once
#include <mpuvdb/operations.h>

#include <cstdint>
#include <string>
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

    bool isSound() const { return findings.empty(); }
};

/// voxelize(), and what it came to. @param explained  is filled.
LevelSet voxelize(const Mesh& mesh, const SampleSettings& settings, MeshExplained& explained,
                  Progress& progress);

} // namespace mpuvdb
