#include <mpuvdb/particles.h>

#include "grid/band_limits.h"
#include "grid/transform_lattice.h"
#include "particle_attributes.h"
#include "particle_bins.h"
#include "particle_implicit.h"
#include "particle_spacing.h"
#include "sampling/max_lost.h"

#include <mpuvdb/attribute_grids.h>
#include <mpuvdb/distances.h>
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <fmt/format.h>
#include <openvdb/tools/Interpolation.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

/// Edge of a voxel by default, radii. [derived: a ball is four voxels across, the smallest that a
/// band resolves]
constexpr double kVoxelSize = 0.5;

Box3d boundsOf(const Particles& particles)
{
    Box3d box;
    for (const Vec3f& p : particles.positions) box.extend(p.cast<double>());
    return box;
}

void requireOptions(const ParticleOptions& options)
{
    requireHalfWidth(options.halfWidth);
    if (!(options.radiusScale > 0 && std::isfinite(options.radiusScale)))
        throw UsageError(fmt::format("particles: the scale of their radii is {}; it must be above "
                                     "0 and finite",
                                     options.radiusScale));
}

/// @throws UsageError for attributes of another number than the particles.
void requireWhole(const Particles& particles)
{
    const auto require = [&](std::size_t count, const std::string& what) {
        if (count != 0 && count != particles.size())
            throw UsageError(fmt::format("{} particles with {} {}: give one for each, or none",
                                         particles.size(), count, what));
    };
    require(particles.radii.size(), "radii");
    require(particles.velocities.size(), "velocities");
    require(particles.colors.size(), "colors");
    for (const NamedScalars& s : particles.scalars) require(s.values.size(), "values of " + s.name);
}

/// @throws InputError for radii that no ball has.
void requireRadii(const std::vector<float>& radii)
{
    const auto isBad = [](float r) { return !(r > 0 && std::isfinite(r)); };
    const auto first = std::find_if(radii.begin(), radii.end(), isBad);
    if (first == radii.end()) return;
    throw InputError(fmt::format(
        "particle {}: its radius is {:g} ({} of {} are not above 0, or not finite): a ball's is "
        "above 0. "
        "Leave such particles out where they come from, or give one radius for all with --radius",
        first - radii.begin(), *first, std::count_if(first, radii.end(), isBad), radii.size()));
}

/// A positive length. @param what  its name. @param bounds  whose diagonal % is a part of.
/// @param voxelSize  world units; empty: not known yet.
double resolved(const Length& length, const char* what, const Box3d& bounds,
                std::optional<double> voxelSize = {})
{
    if (length.unit == Length::Unit::Voxels && !voxelSize)
        throw UsageError(fmt::format("particles: the {} is given in voxels, whose size is not: "
                                     "give it in world units or %{}",
                                     what,
                                     what == std::string("radius") ? ", or a voxel size" : ""));
    const double value = length.resolve(voxelSize.value_or(0), bounds.diagonal().norm());
    if (!(value > 0 && std::isfinite(value)))
        throw UsageError(fmt::format("particles: the {} is {:g}; it must be above 0", what, value));
    return value;
}

/// Give all particles a radius, by the options or as measured.
void chooseRadii(Particles& particles, const ParticleOptions& options, const Box3d& bounds,
                 ParticleReport& report, Interrupter& progress)
{
    std::vector<float>& radii = particles.radii;
    if (options.radius) {
        std::optional<double> voxelSize;
        if (options.voxelSize) voxelSize = resolved(*options.voxelSize, "voxel size", bounds);
        radii.assign(particles.size(),
                     float(resolved(*options.radius, "radius", bounds, voxelSize)));
    } else if (radii.empty()) {
        progress.beginStage("measure");
        report.spacing = particleSpacing(particles.positions, progress);
        radii.assign(particles.size(), float(*report.spacing / kSpacingOfBall));
    }
    if (options.radiusScale != 1)
        for (float& r : radii) r = float(options.radiusScale * double(r));
    requireRadii(radii);
    std::vector<float> sorted = radii;
    const auto middle = sorted.begin() + std::ptrdiff_t(sorted.size() / 2);
    std::nth_element(sorted.begin(), middle, sorted.end());
    const auto [low, high] = std::minmax_element(radii.begin(), radii.end());
    report.smallestRadius = double(*low);
    report.medianRadius = double(*middle);
    report.largestRadius = double(*high);
}

/// @throws LimitError where indices or floats do not resolve the voxels.
void requireRange(const Box3d& bounds, double radius, double voxelSize)
{
    constexpr double kMaxVoxels = 1 << 23; ///< [derived: 2^20 blocks of 8]
    const double across = (bounds.sizes().maxCoeff() + 2 * radius) / voxelSize;
    if (!(across < kMaxVoxels))
        throw LimitError(fmt::format("particles: {:.3g} voxels of size {:.4g} lie along their "
                                     "longest side, beyond the index range: use larger voxels",
                                     across, voxelSize));
}

/// The level set of @a surface. @param shift  of the lattice from the particles' frame.
LevelSet distancesTo(const ParticleImplicit& surface, const Lattice& lattice, double halfWidth,
                     Interrupter& progress)
{
    const auto implicit = openvdb::FloatGrid::create(surface.tree);
    setLattice(*implicit, lattice);
    implicit->setGridClass(openvdb::GRID_LEVEL_SET);
    implicit->setName("surface");
    progress.beginStage("distances");
    return redistance(*implicit, halfWidth, &progress);
}

/// One grid of the velocities' components, the first three grids from @a from on.
openvdb::Vec3SGrid::Ptr velocityGrid(std::vector<openvdb::GridBase::Ptr>::const_iterator from)
{
    std::array<openvdb::FloatGrid::ConstPtr, 3> parts;
    for (std::size_t axis = 0; axis < 3; ++axis)
        parts[axis] = openvdb::gridConstPtrCast<openvdb::FloatGrid>(from[std::ptrdiff_t(axis)]);
    auto tree = std::make_shared<openvdb::Vec3STree>(parts[0]->tree(), openvdb::Vec3s(0),
                                                     openvdb::TopologyCopy());
    for (auto leaf = tree->beginLeaf(); leaf; ++leaf)
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const auto& values = *parts[axis]->tree().probeConstLeaf(leaf->origin());
            for (openvdb::Index n = 0; n < values.size(); ++n)
                leaf->buffer().data()[n][int(axis)] = values.getValue(n);
        }
    auto grid = openvdb::Vec3SGrid::create(tree);
    grid->setTransform(parts[0]->transform().copy());
    grid->setName(kVelocityName);
    grid->setVectorType(openvdb::VEC_CONTRAVARIANT_RELATIVE);
    grid->insertMeta("mpuvdb:quantity",
                     openvdb::StringMetadata("velocity, world units per second"));
    return grid;
}

/// Grids of what the particles carry.
std::vector<openvdb::GridBase::Ptr> gridsBeside(const LevelSet& levelSet,
                                                const Particles& particles,
                                                const ParticleOctaves& octaves, bool velocity,
                                                Interrupter& progress)
{
    const ParticleAttributes attributes(particles, octaves, velocity);
    if (attributes.channels() == 0) return {};
    for (const NamedScalars& scalars : particles.scalars)
        if (scalars.name == kVelocityName && velocity && !particles.velocities.empty())
            throw UsageError("attribute 'v': the grid of velocities has that name. Rename it, or "
                             "do without velocities");
    std::vector<openvdb::GridBase::Ptr> grids = sampleAttributes(levelSet, attributes, &progress);
    if (!velocity || particles.velocities.empty()) return grids;
    const auto first = grids.begin() + std::ptrdiff_t(attributes.hasColors() ? 1 : 0);
    const openvdb::Vec3SGrid::Ptr velocities = velocityGrid(first);
    grids.erase(first, first + 3);
    grids.insert(grids.begin(), velocities);
    return grids;
}

/// Count the balls that the surface does not reach: voxels pass them by.
/// @param shift  of the lattice's origin to the particles' frame, world units.
void findLost(const LevelSet& levelSet, const Particles& particles, const Vec3d& shift,
              ParticleReport& report, Interrupter& progress)
{
    using Accessor = openvdb::tree::ValueAccessor<const openvdb::FloatTree, /*IsSafe=*/false>;
    const double h = levelSet.voxelSize();
    std::vector<std::uint8_t> isLost(particles.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, particles.size(), 1024),
                      [&](const tbb::blocked_range<std::size_t>& range) {
                          progress.check();
                          const Accessor band(levelSet.grid().tree());
                          for (std::size_t n = range.begin(); n < range.end(); ++n) {
                              const Vec3d at = (particles.positions[n].cast<double>() + shift) / h;
                              const float distance = openvdb::tools::BoxSampler::sample(
                                  band, openvdb::Vec3d(at[0], at[1], at[2]));
                              isLost[n] = distance >= particles.radii[n];
                          }
                      });
    double largest = 0;
    for (std::size_t n = 0; n < isLost.size(); ++n) {
        report.lost += isLost[n];
        if (isLost[n]) largest = std::max(largest, double(particles.radii[n]));
    }
    if (report.lost == 0) return;
    const std::string text = fmt::format("{} of {} particles, of radii up to {:.4g}, are smaller "
                                         "than the voxels of {:.4g} show, and "
                                         "are missing: use smaller voxels, or leave them out",
                                         report.lost, particles.size(), largest, h);
    const bool isMuch = double(report.lost) > kMaxLost * double(particles.size());
    (isMuch ? report.findings : report.warnings).push_back(text);
}

} // namespace

ParticleResult particlesToLevelSet(Particles&& particles, const ParticleOptions& options,
                                   Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    requireOptions(options);
    if (particles.positions.empty()) throw InputError("no particles: the input is empty");
    requireWhole(particles);
    ParticleResult result;
    ParticleReport& report = result.report;
    report.particles = particles.size();
    report.dropped = std::move(particles.dropped);
    report.notes = std::move(particles.notes);
    report.warnings = std::move(particles.warnings);
    const Box3d bounds = boundsOf(particles);
    chooseRadii(particles, options, bounds, report, progress);
    report.voxelSize = options.voxelSize ? resolved(*options.voxelSize, "voxel size", bounds)
                                         : kVoxelSize * report.medianRadius;
    report.halfWidth = options.halfWidth;
    requireRange(bounds, report.largestRadius, report.voxelSize);
    const Lattice lattice = latticeFor(bounds.translated(particles.frame), report.voxelSize);
    progress.beginStage("sort");
    const ParticleOctaves octaves = binParticles(particles.positions, particles.radii, progress);
    const ParticleImplicit implicit =
        sampleParticles(octaves, {lattice.origin - particles.frame, lattice.voxelSize},
                        options.surface, options.maxBytes.value_or(0), progress);
    report.blocks = implicit.blocks;
    report.bytes = bytesFor(particles.size(), std::size_t(implicit.blocks));
    const LevelSet levelSet = distancesTo(implicit, lattice, options.halfWidth, progress);
    progress.endStage();
    if (levelSet.grid().empty())
        throw InputError(fmt::format("particles: at voxels of size {:.4g} nothing is inside of "
                                     "balls of radius {:.4g}. Use smaller voxels",
                                     report.voxelSize, report.medianRadius));
    findLost(levelSet, particles, particles.frame - lattice.origin, report, progress);
    result.beside = gridsBeside(levelSet, particles, octaves, options.velocity, progress);
    // Nobody else holds the grid: the level set is made here, and goes now.
    result.grid = std::const_pointer_cast<openvdb::FloatGrid>(levelSet.gridPtr());
    return result;
}

} // namespace mpuvdb
