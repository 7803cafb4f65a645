#include "shape_plan.h"

#include "grid/band_limits.h"
#include "modelling/one_lattice.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace mpuvdb
{
namespace
{

void requireSettings(const Shape::Node& root, const ShapeSettings& settings)
{
    requireHalfWidth(settings.halfWidth);
    if (!root.bounds().isEmpty() && !isFinite(root.bounds()))
        throw UsageError(fmt::format("the shape ({}) is unbounded, and a grid is not: intersect it "
                                     "with a box or another solid",
                                     root.name()));
}

/// Whether the voxels of @a box have indices that floats and any band leave room for.
bool isNear(const Lattice& lattice, const Box3d& box)
{
    constexpr double kMaxIndex = 1 << 22; // [derived: a quarter of 2^24, to which floats are exact]
    if (box.isEmpty()) return true;
    const Vec3d reach =
        (box.min() - lattice.origin).cwiseAbs().cwiseMax((box.max() - lattice.origin).cwiseAbs());
    return reach.maxCoeff() < kMaxIndex * lattice.voxelSize;
}

/// The lattice of a level set in the expression with voxels of that size, so that it need not be
/// resampled; else one aligned to the world.
Lattice latticeOfResult(const Shape::Node& root, double voxelSize)
{
    std::vector<const Shape::Node*> open{&root};
    while (!open.empty()) {
        const Shape::Node& node = *open.back();
        open.pop_back();
        const LevelSet* const grid = levelSetIn(node);
        if (grid && std::abs(grid->voxelSize() - voxelSize) <= 1e-6 * voxelSize &&
            isNear(grid->lattice(), root.bounds()))
            return grid->lattice();
        for (auto input = node.inputs().rbegin(); input != node.inputs().rend(); ++input)
            open.push_back(input->get());
    }
    Box3d box = root.bounds();
    if (box.isEmpty()) box.extend(Vec3d(Vec3d::Zero()));
    return latticeFor(box, voxelSize);
}

/// The name of what @a root makes: that of the grid that all operations begin with.
std::string nameOfResult(const Shape::Node& root)
{
    const Shape::Node* first = &root;
    while (!first->inputs().empty()) first = first->inputs().front().get();
    const LevelSet* const grid = levelSetIn(*first);
    return grid ? grid->grid().getName() : SampleSettings().name;
}

bool same(const Lattice& a, const Lattice& b)
{
    return a.origin == b.origin && a.voxelSize == b.voxelSize;
}

} // namespace

ShapePlan::ShapePlan(const Shape::Node& root, const ShapeSettings& settings) : mSettings(settings)
{
    requireSettings(root, settings);
    find(root, latticeOfResult(root, settings.voxelSize));
    propagateRequests(settings.halfWidth);
}

/// The task of @a node on @a lattice, with all tasks below it.
std::size_t ShapePlan::find(const Shape::Node& node, const Lattice& lattice)
{
    for (const std::size_t n : mTasksOf[&node])
        if (same(mTasks[n].request.lattice, lattice)) return n;
    Task task;
    task.node = &node;
    task.request.lattice = lattice;
    Request any{lattice, mSettings.halfWidth, node.bounds()};
    for (std::size_t n = 0; n < node.inputs().size(); ++n)
        task.inputs.push_back(find(*node.inputs()[n], node.requestOf(n, any).lattice));
    mTasksOf[&node].push_back(mTasks.size());
    mTasks.push_back(std::move(task));
    return mTasks.size() - 1;
}

void ShapePlan::propagateRequests(double halfWidth)
{
    const auto withBand = [](const Shape::Node& node, const Request& request) {
        return grown(node.bounds(), request.band() + request.lattice.voxelSize);
    };
    Request& result = mTasks.back().request;
    result.halfWidth = halfWidth;
    result.region = withBand(*mTasks.back().node, result);
    for (std::size_t n = mTasks.size(); n-- > 0;) {
        const Task& task = mTasks[n];
        if (!task.isRequested()) continue;
        for (std::size_t i = 0; i < task.inputs.size(); ++i) {
            Task& input = mTasks[task.inputs[i]];
            const Request more = task.node->requestOf(i, task.request);
            const Box3d region = more.region.intersection(withBand(*input.node, more));
            if (region.isEmpty()) continue;
            input.request.halfWidth = std::max(input.request.halfWidth, more.halfWidth);
            input.request.region.extend(region);
        }
    }
    for (Task& task : mTasks) {
        if (!task.isRequested()) continue;
        task.area = task.node->area(task.request.region);
        // One that asks for nothing of an input is given what others ask for, and is a use, too.
        for (const std::size_t input : task.inputs) ++mTasks[input].uses;
    }
}

std::uint64_t ShapePlan::Task::bytes() const
{
    return std::uint64_t(gridBytes(area, request.lattice.voxelSize, request.halfWidth));
}

std::vector<PlanStep> ShapePlan::steps() const
{
    std::vector<PlanStep> steps;
    std::vector<bool> seen(mTasks.size(), false);
    addSteps(mTasks.size() - 1, 0, seen, steps);
    return steps;
}

void ShapePlan::addSteps(std::size_t n, int depth, std::vector<bool>& seen,
                         std::vector<PlanStep>& steps) const
{
    const Task& task = mTasks[n];
    PlanStep step;
    step.what = task.node->name();
    step.depth = depth;
    step.shared = seen[n];
    step.halfWidth = task.request.halfWidth;
    step.voxelSize = task.request.lattice.voxelSize;
    step.region = task.request.region;
    const double h = step.voxelSize;
    step.voxels = std::uint64_t(2 * step.halfWidth * task.area / (h * h));
    step.bytes = task.bytes();
    steps.push_back(std::move(step));
    if (seen[n]) return;
    seen[n] = true;
    for (const std::size_t input : task.inputs) addSteps(input, depth + 1, seen, steps);
}

std::uint64_t ShapePlan::peakBytes() const
{
    std::vector<std::size_t> left(mTasks.size());
    std::uint64_t live = 0, peak = 0;
    for (std::size_t n = 0; n < mTasks.size(); ++n) {
        const Task& task = mTasks[n];
        if (!task.isRequested()) continue;
        left[n] = task.uses;
        live += task.bytes();
        peak = std::max(peak, live + std::uint64_t(task.node->workingBytes(task.request)));
        for (const std::size_t input : task.inputs) {
            const Task& used = mTasks[input];
            if (used.isRequested() && --left[input] == 0) live -= used.bytes();
        }
    }
    return peak;
}

void ShapePlan::requireMemory() const
{
    if (!mSettings.maxBytes) return;
    const std::uint64_t peak = peakBytes();
    if (peak <= mSettings.maxBytes) return;
    // Grids of surfaces grow with the square of the resolution.
    const double larger = std::sqrt(double(peak) / double(mSettings.maxBytes));
    throw LimitError(fmt::format("the shape needs about {:.0f} MB at voxels of size {}, more than "
                                 "the limit of {:.0f} MB: voxels of size {:.3g} fit",
                                 double(peak) / 1e6, mSettings.voxelSize,
                                 double(mSettings.maxBytes) / 1e6,
                                 1.05 * larger * mSettings.voxelSize));
}

void ShapePlan::requireFewVoxels() const
{
    std::vector<Resampled> grids;
    for (const Task& task : mTasks)
        if (const LevelSet* const grid = levelSetIn(*task.node); grid && task.isRequested())
            grids.push_back({double(grid->grid().activeVoxelCount()), grid->voxelSize(),
                             task.request.lattice.voxelSize, grid->halfWidth()});
    mpuvdb::requireFewVoxels(grids);
}

void ShapePlan::noteThinSolids(Interrupter& progress) const
{
    /// Thickness, voxels, below which a solid may lie between voxels. [derived: the diagonal of a
    /// voxel, which is the diameter of the largest ball between them]
    const double kLeastVoxels = std::sqrt(3.0);
    std::size_t solids = 0, thin = 0;
    double thinnest = kLeastVoxels; // voxels
    const Shape::Node* which = nullptr;
    for (const Task& task : mTasks) {
        if (!task.isRequested() || !task.node->inputs().empty()) continue;
        ++solids;
        const double h = task.request.lattice.voxelSize;
        const double voxels = task.node->bounds().sizes().minCoeff() / h;
        const LevelSet* const grid = levelSetIn(*task.node);
        const bool isAsFine = grid && grid->voxelSize() >= h * (1 - 1e-6); // shows no more detail
        if (isAsFine || !(voxels < kLeastVoxels)) continue;
        ++thin;
        if (voxels >= thinnest) continue;
        thinnest = voxels;
        which = task.node;
    }
    if (which)
        progress.note(fmt::format("{} of {} solids {} thinner than a voxel's diagonal (the "
                                  "thinnest, {}: {:.2g} voxels) and may be lost between voxels, or "
                                  "have another volume. Use smaller voxels",
                                  thin, solids, thin == 1 ? "is" : "are", which->name(), thinnest));
}

LevelSet ShapePlan::evaluate(Interrupter& progress) const
{
    noteThinSolids(progress);
    std::vector<std::optional<LevelSet>> grids(mTasks.size());
    std::vector<std::size_t> left(mTasks.size());
    for (std::size_t n = 0; n < mTasks.size(); ++n) {
        const Task& task = mTasks[n];
        if (!task.isRequested()) continue;
        progress.check();
        left[n] = task.uses;
        Inputs inputs;
        for (const std::size_t input : task.inputs)
            inputs.push_back(grids[input] ? &*grids[input] : nullptr);
        grids[n].emplace(task.node->make(inputs, task.request, mSettings.maxBytes, progress));
        for (const std::size_t input : task.inputs)
            if (mTasks[input].isRequested() && --left[input] == 0) grids[input].reset();
    }
    const Task& root = mTasks.back();
    const std::string name = nameOfResult(*root.node);
    const std::optional<LevelSet>& made = grids.back();
    // Nodes make nothing of inputs that are not there, whose names they do not know.
    if (made && (made->grid().activeVoxelCount() > 0 || made->grid().getName() == name))
        return *made;
    return emptyLevelSet(root.request.lattice, root.request.halfWidth, name);
}

} // namespace mpuvdb
