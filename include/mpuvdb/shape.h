// Solids as expressions: planned and evaluated when a level set is requested.
//
// A narrow band has no distances beyond it, so operations need wider bands of their inputs: a blend
// of radius r one wider by r, a warp one wider by its stretch, a linear morph one that reaches from
// surface to surface. Evaluation walks down from the result, finds for each node the band and the
// region that its consumers need, samples every leaf once, and frees every grid after its last use.
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
struct RepairSettings;

/// Settings of an evaluation.
struct ShapeSettings {
    double voxelSize = 0;       ///< world units, > 0
    double halfWidth = 3;       ///< voxels, in [1.5, 1000]
    std::uint64_t maxBytes = 0; ///< limit of the memory of all grids together; 0: none
};

/// One step of a plan, in the order of the expression: a node before its inputs.
struct PlanStep {
    std::string what;         ///< "union", "sphere", ...
    int depth = 0;            ///< below the result
    bool shared = false;      ///< listed before, by an equal step
    double halfWidth = 0;     ///< voxels
    double voxelSize = 0;     ///< world units
    Box3d region;             ///< of the evaluation, world units
    std::uint64_t voxels = 0; ///< active, estimated
    std::uint64_t bytes = 0;  ///< of its grid, estimated
};

/// An immutable solid, cheap to copy; equal parts are shared. All members may be called from any
/// thread.
class Shape
{
public:
    /// @{ Leaves.
    /// @param name  in plans.
    Shape(FieldPtr field, std::string name);
    /// A level set; resampled where the result's lattice differs.
    explicit Shape(LevelSet levelSet, std::string name = "grid");
    /// A closed triangle mesh, by voxelize().
    explicit Shape(std::shared_ptr<const Mesh> mesh, std::string name = "mesh");
    /// A broken one, repaired.
    Shape(std::shared_ptr<const Mesh> mesh, const RepairSettings& repair,
          std::string name = "mesh");
    /// @}

    /// @{ Booleans; @a blendRadius as in combine().
    static Shape combine(Boolean kind, std::vector<Shape> shapes, double blendRadius = 0);
    friend Shape operator|(const Shape& a, const Shape& b);
    friend Shape operator&(const Shape& a, const Shape& b);
    friend Shape operator-(const Shape& a, const Shape& b);
    /// @}

    /// @{ See operations.h and fields.h. Fields are moved and warped exactly, before they are
    /// sampled.
    Shape offset(double distance) const;
    Shape shell(double thickness, Wall wall) const;
    Shape smooth(const SmoothSettings& settings) const;
    Shape moved(const Eigen::Affine3d& motion) const;
    Shape warped(const std::shared_ptr<const Warp>& warp, const std::string& name) const;
    static Shape morph(const Shape& a, const Shape& b, double t, Morphing how);
    /// @}

    /// A box around the solid, world units; infinite where the solid is. That of a level set may be
    /// an eighth of a voxel too small at corners.
    Box3d bounds() const;
    /// The voxel size of the finest level set in the expression, world units; 0 without any.
    double voxelSize() const;
    /// A field with the solid's exact zero set, creases included, for ExtractSettings. Null for
    /// grids and meshes, offsets, shells, blends, filters and morphs, and functions that are slow
    /// at single places.
    FieldPtr field() const;
    /// The plan of evaluate(). @throws as evaluate(), but for memory.
    std::vector<PlanStep> plan(const ShapeSettings& settings) const;
    /// The plan as text, one line per step, and the peak of memory.
    std::string explain(const ShapeSettings& settings) const;
    /// The largest memory of all grids that exist at the same time in evaluate(), bytes; estimated.
    std::uint64_t peakBytes(const ShapeSettings& settings) const;
    /// Checks voxel sizes that no user chose, see onOneLattice(). @throws LimitError where the
    /// level sets in the expression would take more than 64 times the voxels that they have.
    void requireFewVoxels(const ShapeSettings& settings) const;
    /// @throws LimitError if peakBytes() is above the limit of @a settings; as plan().
    void requireMemory(const ShapeSettings& settings) const;
    /// The level set of the solid. @throws UsageError (settings, an unbounded solid), LimitError
    /// (memory, before it is taken), InputError, Interrupted.
    LevelSet evaluate(const ShapeSettings& settings, Interrupter* interrupter = nullptr) const;

    class Node;

private:
    explicit Shape(std::shared_ptr<const Node> node) : mNode(std::move(node)) {}
    std::shared_ptr<const Node> mNode;
};

} // namespace mpuvdb
