#include "particle_implicit.h"

#include "core/clones.h"
#include "core/lanes.h"
#include "core/parallel_each.h"
#include "core/quantile.h"
#include "fill_bubbles.h"
#include "particle_blocks.h"
#include "particle_kernels.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/memory.h>

#include <fmt/format.h>
#include <openvdb/tools/SignedFloodFill.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <tuple>

namespace mpuvdb
{
namespace
{

using Leaf = openvdb::FloatTree::LeafNodeType;
using Lanes = float __attribute__((vector_size(32)));
using Rows = std::array<Lanes, kBlockDim * kBlockDim>; ///< a block's rows of z, by x and y

/// Memory of a particle and of a block, bytes. [derived: sizes of a particle's place, kernel and
/// attributes, twice while they are sorted; of a block's values and distances, a leaf each, and of
/// the closest patches from which distances are made]
constexpr std::uint64_t kBytesPerParticle = 200, kBytesPerBlock = 16000;

/// Radius of the largest gap that is no bubble, radii of the particles. [derived: what one missing
/// particle leaves among others that touch]
constexpr double kGap = 2;

/// Kernels between two checks for a stop. [free: the same values]
constexpr std::size_t kBetweenChecks = 1024;

/// Voxels of a block along an axis.
struct Range {
    int first, last;
};

/// The voxels within @a reach of @a center, both in voxels of the block.
Range rangeOf(float center, float reach)
{
    return {std::max(0, int(std::ceil(center - reach))),
            std::min(kBlockDim - 1, int(std::floor(center + reach)))};
}

/// A row's offsets from a center, along z.
Lanes offsetsFrom(float center)
{
    const Lanes along = {0, 1, 2, 3, 4, 5, 6, 7};
    return along - center;
}

/// Add a kernel to the rows of a block. @param center, reach  voxels of the block.
/// @param form  of the kernel, per voxel^2.
MPUVDB_CLONES
void addKernel(Rows& rows, const Vec3f& center, const Vec3f& reach,
               const std::array<float, 6>& form, float weight)
{
    const Range xs = rangeOf(center[0], reach[0]), ys = rangeOf(center[1], reach[1]);
    const Lanes z = offsetsFrom(center[2]);
    const Lanes square = 1 - form[2] * z * z, twice = 2 * z;
    for (int i = xs.first; i <= xs.last; ++i) {
        const float x = float(i) - center[0];
        for (int j = ys.first; j <= ys.last; ++j) {
            const float y = float(j) - center[1];
            const float across = form[0] * x * x + form[1] * y * y + 2 * form[3] * x * y;
            Lanes t = square - across - twice * (form[4] * x + form[5] * y);
            t = t > 0 ? t : Lanes{};
            rows[std::size_t(i * kBlockDim + j)] += weight * (t * t * t);
        }
    }
}

/// Raise the rows of a block to scale * (1 - q^2), where q is the distance from a center over
/// @a support. @param center, support  voxels of the block.
MPUVDB_CLONES
void raiseToBall(Rows& rows, const Vec3f& center, float support, float scale)
{
    const Range xs = rangeOf(center[0], support), ys = rangeOf(center[1], support);
    const Lanes z = offsetsFrom(center[2]);
    const float perSquare = 1 / (support * support);
    for (int i = xs.first; i <= xs.last; ++i) {
        const float x = float(i) - center[0];
        for (int j = ys.first; j <= ys.last; ++j) {
            const float y = float(j) - center[1];
            const Lanes value = scale * (1 - perSquare * (z * z + (x * x + y * y)));
            Lanes& row = rows[std::size_t(i * kBlockDim + j)];
            row = value > row ? value : row;
        }
    }
}

/// Lower the rows of a block to the distances from a ball. @param center, radius, reach  voxels;
/// what lies farther than the reach from the ball keeps its value.
MPUVDB_CLONES
void lowerToBall(Rows& rows, const Vec3f& center, float radius, float reach)
{
    const Range xs = rangeOf(center[0], radius + reach), ys = rangeOf(center[1], radius + reach);
    const Lanes z = offsetsFrom(center[2]);
    for (int i = xs.first; i <= xs.last; ++i) {
        const float x = float(i) - center[0];
        for (int j = ys.first; j <= ys.last; ++j) {
            const float y = float(j) - center[1];
            const Lanes squares = z * z + (x * x + y * y);
            Lanes distance;
            for (int k = 0; k < kBlockDim; ++k) distance[k] = std::sqrt(squares[k]);
            distance -= radius;
            Lanes& row = rows[std::size_t(i * kBlockDim + j)];
            row = distance < row ? distance : row;
        }
    }
}

/// A function of particles, block by block.
class BlockFunction
{
public:
    BlockFunction(const ParticleOctaves& octaves, const Lattice& lattice)
        : mOctaves(octaves), mLattice(lattice)
    {
    }
    virtual ~BlockFunction() = default;
    /// The values far outside and far inside.
    virtual float outside() const = 0;
    virtual float inside() const = 0;
    /// Get ready for blocks of these boxes. @param units  by which the running stage advances.
    virtual void prepare(const std::vector<Box3d>& blocks, double units, Interrupter& progress) = 0;
    /// The values of a block by the particles in and about @a box, that of its voxel centers.
    virtual void evaluate(const Box3d& box, Rows& rows, Interrupter& progress) const = 0;

protected:
    const ParticleOctaves& mOctaves;
    Lattice mLattice;
};

/// The cube root of the iso value less that of the sum of all kernels, or of the largest lone
/// kernel where that is more: of a lone particle, it is its squared distance. Smaller particles in
/// a ball have a share in the sum, and would bring the surface down to themselves.
class KernelFunction final : public BlockFunction
{
public:
    KernelFunction(const ParticleOctaves& octaves, const Lattice& lattice)
        : BlockFunction(octaves, lattice), mKernels(octaves)
    {
    }
    float outside() const override { return std::cbrt(float(kIsoValue)); }
    float inside() const override { return outside() - 1; }
    void prepare(const std::vector<Box3d>& blocks, double units, Interrupter& progress) override
    {
        mKernels.makeWithin(blocks, units, progress);
    }
    void evaluate(const Box3d& box, Rows& rows, Interrupter& progress) const override
    {
        rows.fill(Lanes{});
        Rows balls;
        balls.fill(Lanes{});
        std::size_t count = 0;
        const double h = mLattice.voxelSize;
        const auto size = float(h), square = float(h * h);
        const Eigen::Array3f low = box.min().cast<float>(), high = box.max().cast<float>();
        mKernels.forEachNear(box, [&](const ParticleKernel& kernel) {
            if (++count % kBetweenChecks == 0) progress.check();
            const float ball = kernel.hasBall() ? kernel.loneSupport : 0;
            const Eigen::Array3f center = kernel.center, reach = kernel.reach.cwiseMax(ball);
            if ((center + reach < low).any() || (center - reach > high).any()) return;
            const Vec3f at = ((kernel.center.cast<double>() - box.min()) / h).cast<float>();
            std::array<float, 6> form;
            for (std::size_t n = 0; n < form.size(); ++n) form[n] = square * kernel.form[n];
            addKernel(rows, at, kernel.reach / size, form, kernel.weight);
            if (ball > 0) raiseToBall(balls, at, ball / size, std::cbrt(kernel.loneWeight));
        });
        const float root = outside();
        for (std::size_t n = 0; n < rows.size(); ++n)
            for (int k = 0; k < kBlockDim; ++k)
                rows[n][k] = root - std::max(std::cbrt(rows[n][k]), balls[n][k]);
    }

private:
    ParticleKernels mKernels;
};

/// The distance to the nearest ball: exact outside, and on the union's surface.
class BallFunction final : public BlockFunction
{
public:
    using BlockFunction::BlockFunction;
    float outside() const override { return kReach; }
    float inside() const override { return -kReach; }
    void prepare(const std::vector<Box3d>&, double units, Interrupter& progress) override
    {
        progress.advance(units);
    }
    void evaluate(const Box3d& box, Rows& rows, Interrupter& progress) const override
    {
        rows.fill(Lanes{} + kReach);
        const double h = mLattice.voxelSize;
        for (const ParticleBins& bins : mOctaves) {
            const Vec3d reach = Vec3d::Constant(bins.largestRadius() + double(kReach) * h);
            const auto add = [&](const ParticleBins::Run& run) {
                progress.check();
                for (std::uint32_t n = run.begin; n < run.end; ++n)
                    addBall(bins.center(n).cast<double>(), double(bins.radius()[n]), box, rows);
            };
            bins.forEachRunIn({box.min() - reach, box.max() + reach}, add);
        }
    }

private:
    /// Distances from a ball as far as the rows hold them, voxels. [derived: a voxel beyond the
    /// corners of the cells that the surface crosses]
    static constexpr float kReach = 3;

    void addBall(const Vec3d& center, double radius, const Box3d& box, Rows& rows) const
    {
        const double h = mLattice.voxelSize;
        if (box.squaredExteriorDistance(center) > std::pow(radius + double(kReach) * h, 2)) return;
        const Vec3f at = ((center - box.min()) / h).cast<float>();
        lowerToBall(rows, at, float(radius / h), kReach);
    }
};

void requireMemory(std::size_t particles, std::size_t blocks, double voxelSize,
                   std::uint64_t maxBytes)
{
    const std::uint64_t bytes = bytesFor(particles, blocks);
    if (maxBytes && bytes > maxBytes)
        throw LimitError(fmt::format("particles: {} at least are needed for {} blocks of 8 x 8 x 8 "
                                     "voxels of size {:.4g}, and the limit is {}. Use larger "
                                     "voxels or a larger --max-memory",
                                     sizeText(bytes), blocks, voxelSize, sizeText(maxBytes)));
}

/// The fewest blocks that a surface has which encloses a ball of @a radius: seen from its middle
/// they cover it, and none covers more than the disc about a block.
double fewestBlocks(double radius, double voxelSize)
{
    const double across = std::sqrt(3.0) / 2 * kBlockDim * voxelSize; // the disc's radius
    return 4 * std::pow(radius / across, 2);
}

openvdb::Coord originOf(const Vec3i& block)
{
    return {kBlockDim * block[0], kBlockDim * block[1], kBlockDim * block[2]};
}

/// Samples blocks from those near the particles on, until the surface lies among them.
class Mosaic
{
public:
    /// @param scale  of all values, world units.
    Mosaic(BlockFunction& function, const ParticleBlocks& blocks, double scale,
           Interrupter& progress)
        : mFunction(function), mBlocks(blocks), mScale(float(scale)), mProgress(progress),
          mTree(std::make_shared<openvdb::FloatTree>(mScale * function.outside()))
    {
    }

    /// Evaluate @a blocks, none of which was. @return those beside them that are needed, too.
    std::vector<Vec3i> add(const std::vector<Vec3i>& blocks)
    {
        std::vector<Box3d> boxes(blocks.size());
        for (std::size_t n = 0; n < blocks.size(); ++n) boxes[n] = mBlocks.boxOf(blocks[n]);
        mFunction.prepare(boxes, double(boxes.size()), mProgress);
        std::vector<std::unique_ptr<Leaf>> leaves(blocks.size());
        forEachParallel(blocks.size(), 1, mProgress, [&](std::size_t n) {
            Rows rows;
            mFunction.evaluate(boxes[n], rows, mProgress);
            for (Lanes& row : rows) row *= mScale;
            leaves[n] = std::make_unique<Leaf>(originOf(blocks[n]), 0.0f, true);
            std::memcpy(leaves[n]->buffer().data(), rows.data(), sizeof rows);
            mProgress.advance();
        });
        for (std::unique_ptr<Leaf>& leaf : leaves) mTree->addLeaf(leaf.release());
        return beside(blocks);
    }
    openvdb::FloatTree::Ptr finish()
    {
        openvdb::tools::signedFloodFillWithValues(*mTree, mScale * mFunction.outside(),
                                                  mScale * mFunction.inside());
        return mTree;
    }

private:
    /// Voxels beside a face of a block that have to be of one sign. [derived: the corners of a cell
    /// that the surface crosses, and their neighbors]
    static constexpr int kSlab = 2;

    /// Whether voxels beside a face are not all on the side of @a inside.
    static bool differs(const Leaf& leaf, int face, bool inside)
    {
        const int axis = face / 2;
        const int first = face % 2 ? kBlockDim - kSlab : 0;
        for (int n = 0; n < kBlockVoxels; ++n) {
            const int at = n >> (3 * (2 - axis)) & 7;
            const bool isBeside = at >= first && at < first + kSlab;
            if (isBeside && (leaf.getValue(openvdb::Index(n)) < 0) != inside) return true;
        }
        return false;
    }
    std::vector<Vec3i> beside(const std::vector<Vec3i>& blocks) const
    {
        constexpr std::size_t kGrain = 64; // blocks; [free: the same blocks]
        std::vector<Vec3i> next = gatherParallel<Vec3i>(
            blocks.size(), kGrain, mProgress, [&](std::size_t n, std::vector<Vec3i>& found) {
                const Leaf& leaf = *mTree->probeConstLeaf(originOf(blocks[n]));
                for (int face = 0; face < 6; ++face) {
                    Vec3i at = blocks[n];
                    at[face / 2] += face % 2 ? 1 : -1;
                    if (mTree->probeConstLeaf(originOf(at))) continue;
                    if (differs(leaf, face, mBlocks.isInside(at))) found.push_back(at);
                }
            });
        const auto before = [](const Vec3i& a, const Vec3i& b) {
            return std::make_tuple(a[0], a[1], a[2]) < std::make_tuple(b[0], b[1], b[2]);
        };
        std::sort(next.begin(), next.end(), before);
        next.erase(std::unique(next.begin(), next.end()), next.end());
        return next;
    }

    BlockFunction& mFunction;
    const ParticleBlocks& mBlocks;
    float mScale;
    Interrupter& mProgress;
    openvdb::FloatTree::Ptr mTree;
};

} // namespace

std::uint64_t bytesFor(std::size_t particles, std::size_t blocks)
{
    return kBytesPerParticle * particles + kBytesPerBlock * blocks;
}

ParticleImplicit sampleParticles(const ParticleOctaves& octaves, const Lattice& lattice,
                                 ParticleSurface surface, std::uint64_t maxBytes,
                                 Interrupter& progress)
{
    const bool isSmooth = surface == ParticleSurface::Smooth;
    std::size_t particles = 0;
    for (const ParticleBins& bins : octaves) particles += bins.size();
    const double fewest = fewestBlocks(octaves.back().largestRadius(), lattice.voxelSize);
    // At most so many that their bytes fit 64 bits.
    requireMemory(particles, std::size_t(std::min(fewest, 1e15)), lattice.voxelSize, maxBytes);
    progress.beginStage("blocks");
    const ParticleBlocks blocks(octaves, lattice, isSmooth, progress);
    std::vector<Vec3i> wave = blocks.nearSurface(maxBytes, progress);
    std::unique_ptr<BlockFunction> function;
    if (isSmooth)
        function = std::make_unique<KernelFunction>(octaves, lattice);
    else
        function = std::make_unique<BallFunction>(octaves, lattice);
    progress.beginStage("sample", 2 * double(wave.size())); // later waves are few blocks
    Mosaic mosaic(*function, blocks, lattice.voxelSize, progress);
    ParticleImplicit made;
    while (!wave.empty()) {
        made.blocks += wave.size();
        requireMemory(particles, std::size_t(made.blocks), lattice.voxelSize, maxBytes);
        wave = mosaic.add(wave);
    }
    made.tree = mosaic.finish();
    if (isSmooth) {
        std::vector<float> radii;
        for (const ParticleBins& bins : octaves)
            radii.insert(radii.end(), bins.radius(), bins.radius() + bins.size());
        const double gap = kGap * double(quantile(radii, 0.5)) / lattice.voxelSize;
        fillBubbles(*made.tree, std::uint64_t(4 * M_PI / 3 * std::pow(gap, 3)), progress);
    }
    return made;
}

} // namespace mpuvdb
