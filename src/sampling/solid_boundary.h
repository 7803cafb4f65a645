// The boundary of the solid that a mesh's closed parts make together.
#pragma once
#include "mesh_closure.h"
#include "oriented_triangles.h"
#include "spatial/triangle_tree.h"
#include "winding_number.h"
#include <mpuvdb/sampling.h>

#include <memory>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// Largest width of gaps and walls that are ignored, voxels. [derived: a tenth of the error allowed
/// for values]
constexpr double kTouch = 1e-3;

/// The solid of all places with a winding number of at least one: the union of the parts that face
/// outward, less those that face inward. Places are relative to the mesh's frame.
class SolidBoundary
{
public:
    /// Measures of the solid and of the mesh's defects.
    struct Report {
        double volume = 0, area = 0; ///< of the solid, world units cubed, squared
        double volumeOfHoles = 0;    ///< what holes and gaps add to it, known to a part of itself
        std::uint64_t parts = 0;     ///< surfaces of the boundary that enclose parts of the solid
        std::uint64_t cavities = 0;  ///< surfaces that enclose cavities
        bool isCut = false;          ///< triangles of the mesh meet that are no neighbors
        bool isClosedAnew = false;   ///< holes were closed by repair: the volume is not exact
        std::uint64_t openEdges = 0; ///< edges of the mesh whose triangles do not cancel
        std::uint64_t turned = 0;    ///< triangles turned to face as their neighbors do
        bool insideOut = false;      ///< all parts faced inward, and were turned
        /// Over the mesh's edges and gaps the sum of length times the angle between normals, and
        /// where its parts cross at most pi / 2: the integral of the principal curvatures'
        /// magnitudes, world units.
        double bending = 0;
        double areaWithin = 0;           ///< of triangles inside the solid
        double areaOfNothing = 0;        ///< of parts that face inward and lie in no other
        std::uint64_t copies = 0;        ///< triangles left out for others with the same corners
        std::uint64_t cancelled = 0;     ///< faces that were there for both sides
        std::uint64_t turnedPatches = 0; ///< by repair
        std::uint64_t sheets = 0;        ///< patches that enclose nothing, to be thickened
        double sheetArea = 0;            ///< of these
        std::uint64_t innerWalls = 0;    ///< open patches within the solid, left out
    };

    /// @param mesh  with valid indices. @param repair  null: holes wider than a voxel stay open.
    /// @param isOpen  a closed mesh is repaired as an open one is: no triangle is taken to be as
    /// its neighbors are. @throws Interrupted.
    SolidBoundary(const Mesh& mesh, const Lattice& lattice, const RepairSettings* repair,
                  Interrupter& progress, bool isOpen = false);

    const Report& report() const { return mReport; }
    bool isEmpty() const { return !mTree; }
    /// The triangles that bound the solid, facing outward; those that meet others are cut there.
    /// Undefined if it is empty.
    const TriangleTree& tree() const { return *mTree; }
    /// The triangles of sheets; null without any.
    const TriangleTree* sheets() const { return mSheets.get(); }
    /// Make a sheet of all that is left: it encloses nothing, or less than the voxels show.
    void makeSheet();
    /// The holes that repair closed.
    const MeshClosure& closure() const { return mClosure; }
    bool isInside(const Vec3d& place) const;

private:
    void repairPatches(const Lattice& lattice, const RepairSettings& repair, Interrupter& progress);
    void addClosure(const std::vector<std::array<Vec3d, 2>>& starts, const Lattice& lattice,
                    Mesh& boundary, Interrupter& progress);

    OrientedTriangles mTriangles;
    std::shared_ptr<const TriangleTree> mWhole, mTree; ///< of the mesh; of the boundary
    std::unique_ptr<const TriangleTree> mSheets;
    MeshClosure mClosure;
    Box3d mBox; ///< beyond which nothing is inside
    std::unique_ptr<const WindingNumber> mWinding;
    Report mReport;
};

} // namespace mpuvdb
