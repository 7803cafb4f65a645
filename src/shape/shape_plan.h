// The plan of an evaluation: which nodes, where, in which band, in how much memory.
#pragma once
#include "shape_node.h"

#include <unordered_map>

namespace mpuvdb
{

/// A shape's nodes with the requests of all their consumers.
class ShapePlan
{
public:
    /// @throws UsageError for settings out of range or an unbounded shape; as latticeFor().
    ShapePlan(const Shape::Node& root, const ShapeSettings& settings);

    /// The steps in the order of the expression.
    std::vector<PlanStep> steps() const;
    /// The largest memory of all grids that exist at the same time, bytes; estimated.
    std::uint64_t peakBytes() const;
    /// @throws LimitError if peakBytes() is above the limit.
    void requireMemory() const;
    /// As Shape::requireFewVoxels().
    void requireFewVoxels() const;
    LevelSet evaluate(Interrupter& progress) const;

private:
    /// The evaluation of a node on a lattice.
    struct Task {
        const Shape::Node* node;
        Request request;
        std::vector<std::size_t> inputs; ///< tasks; those of an empty request are not evaluated
        std::size_t uses = 0;            ///< by evaluated tasks
        double area = 0;                 ///< estimated, world units squared

        bool isRequested() const { return !request.region.isEmpty(); }
        std::uint64_t bytes() const; ///< of its grid
    };

    std::size_t find(const Shape::Node& node, const Lattice& lattice);
    void propagateRequests(double halfWidth);
    void noteThinSolids(Interrupter& progress) const;
    void addSteps(std::size_t task, int depth, std::vector<bool>& seen,
                  std::vector<PlanStep>& steps) const;

    ShapeSettings mSettings;
    std::vector<Task> mTasks; ///< inputs before consumers; the root is the last
    /// The tasks of each node, one for each lattice.
    std::unordered_map<const Shape::Node*, std::vector<std::size_t>> mTasksOf;
};

} // namespace mpuvdb
