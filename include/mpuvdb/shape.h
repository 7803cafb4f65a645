// Solids as expressions: described now, planned and evaluated when a level set is asked for.
//
// A narrow band forgets what lies beyond it, so operations need more of their inputs than they give
// back: a blend of radius r a band wider by r, a warp one wider by its stretch, a linear morph one
// that reaches from surface to surface. Evaluation walks down from the result, finds for each node
// the band and the region its consumers need, samples every leaf once, and lets go of every grid
// after its last use.
#pragma once
#include <mpuvdb/fields.h>
#include <mpuvdb/operations.h>
#include <mpuvdb/triangle_mesh.h>

#include <memory>
#include <string>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// What a shape is evaluated to.
struct ShapeSettings {
    double voxelSize = 0;       ///< world units, > 0
    double halfWidth = 3;       ///< voxels, in [1.5, 1000]
    std::uint64_t maxBytes = 0; ///< memory that all grids together may take; 0: no limit
};

/// One step of a plan, as the expression reads: a node before its inputs.
struct PlanStep {
    std::string what;         ///< "union", "sphere", ...
    int depth = 0;            ///< below the result
    bool shared = false;      ///< evaluated before, by an equal step
    double halfWidth = 0;     ///< voxels
    double voxelSize = 0;     ///< world units
    Box3d region;             ///< where it is evaluated, world units
    std::uint64_t voxels = 0; ///< active, estimated
    std::uint64_t bytes = 0;  ///< of its grid, estimated
};

/// An immutable solid, cheap to copy; equal parts are shared. All members may be called from any
/// thread.
class Shape
{
public:
    /// @{ Leaves.
    /// @param name  how plans call it.
    Shape(FieldPtr field, std::string name);
    /// A level set of its own lattice; resampled where the result's differs.
    explicit Shape(LevelSet levelSet, std::string name = "grid");
    /// A closed triangle mesh, by voxelize().
    explicit Shape(std::shared_ptr<const Mesh> mesh, std::string name = "mesh");
    /// @}

    /// @{ Booleans; @a blendRadius as in combine().
    static Shape combine(Boolean kind, std::vector<Shape> shapes, double blendRadius = 0);
    friend Shape operator|(const Shape& a, const Shape& b);
    friend Shape operator&(const Shape& a, const Shape& b);
    friend Shape operator-(const Shape& a, const Shape& b);
    /// @}

    /// @{ See operations.h and fields.h. Fields are moved and warped before they are sampled, so
    /// that nothing is lost.
    Shape offset(double distance) const;
    Shape shell(double thickness, Wall wall) const;
    Shape smooth(const SmoothSettings& settings) const;
    Shape moved(const Eigen::Affine3d& motion) const;
    Shape warped(const std::shared_ptr<const Warp>& warp, const std::string& name) const;
    static Shape morph(const Shape& a, const Shape& b, double t, Morphing how);
    /// @}

    /// A box around the solid, world units; infinite where the solid is.
    Box3d bounds() const;
    /// The voxel size of the finest level set that it is made of, world units; 0 if of none.
    double voxelSize() const;
    /// A field with the solid's zero set, creases included: what makes meshes exact, see
    /// ExtractSettings. Null where there is none: of grids and meshes, of offsets, shells, blends,
    /// filters and morphs, and of functions that cost much at single places.
    FieldPtr field() const;
    /// What evaluate() would do. @throws as evaluate(), but for memory.
    std::vector<PlanStep> plan(const ShapeSettings& settings) const;
    /// The plan as text, one line per step; and the memory of the grids that there are at once.
    std::string explain(const ShapeSettings& settings) const;
    /// Memory of all grids that evaluate() has at the same time, at most, bytes; estimated.
    std::uint64_t peakBytes(const ShapeSettings& settings) const;
    /// @throws LimitError where the level sets that it is made of would take more than 64 times the
    /// voxels that they have: for voxel sizes that nobody chose, see onOneLattice().
    void requireFewVoxels(const ShapeSettings& settings) const;
    /// @throws LimitError if evaluate() would take more memory than @a settings allow, and as
    /// plan().
    void requireMemory(const ShapeSettings& settings) const;
    /// @throws UsageError (settings, an unbounded solid), LimitError (memory, before it is taken),
    /// InputError, Interrupted.
    LevelSet evaluate(const ShapeSettings& settings, Interrupter* interrupter = nullptr) const;

    class Node;

private:
    explicit Shape(std::shared_ptr<const Node> node) : mNode(std::move(node)) {}
    std::shared_ptr<const Node> mNode;
};

} // namespace mpuvdb
