// What has to be evaluated, where, in which band, and what it takes.
#pragma once
#include "shape_node.h"

namespace mpuvdb
{

/// A shape's nodes with the demands of all their consumers.
class ShapePlan
{
public:
    /// @throws UsageError for settings out of range or an unbounded shape, what latticeFor()
    /// throws.
    ShapePlan(const Shape::Node& root, const ShapeSettings& settings);

    /// As the expression reads.
    std::vector<PlanStep> steps() const;
    /// The memory of all grids that there are at the same time, at most; estimated.
    std::uint64_t peakBytes() const;
    /// @throws LimitError if that is above the limit.
    void demandMemory() const;
    /// As Shape::demandFewVoxels().
    void demandFewVoxels() const;
    LevelSet evaluate(Interrupter& progress) const;

private:
    /// A node on a lattice, evaluated once.
    struct Task {
        const Shape::Node* node;
        Demand demand;
        std::vector<std::size_t> inputs; ///< tasks; those of empty demand are not evaluated
        std::size_t uses = 0;            ///< by tasks that are evaluated
        double area = 0;                 ///< estimated, world units squared

        bool wanted() const { return !demand.region.isEmpty(); }
        std::uint64_t bytes() const; ///< of its grid
    };

    std::size_t find(const Shape::Node& node, const Lattice& lattice);
    void spreadDemands(double halfWidth);
    void addSteps(std::size_t task, int depth, std::vector<bool>& seen,
                  std::vector<PlanStep>& steps) const;

    ShapeSettings mSettings;
    std::vector<Task> mTasks; ///< inputs before consumers; the root is the last
};

} // namespace mpuvdb
