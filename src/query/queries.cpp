#include "band_blocks.h"
#include "band_window.h"
#include "core/parallel_each.h"
#include "grid/has_inside.h"
#include "polyhedron_distance.h"
#include "sharp_surface.h"
#include "spatial/radix_sort.h"
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/queries.h>

#include <fmt/format.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <mutex>
#include <optional>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN(); ///< [derived: no number]
/// Places that are sorted at once. [free: time; half as many load blocks twice as often]
constexpr std::size_t kBatch = std::size_t(1) << 20;
/// Places of a task, and rays of one, or far places between two checks for a stop. [free: grain
/// size]
constexpr std::size_t kPlaces = 8192, kFarPlaces = 256;
/// Cells along a cube for which triangles are gathered, and places in one from which on they are.
/// [free: the same answers]
constexpr int kCube = 2;
constexpr std::size_t kShared = 3;
/// Bits of a cube's number in its block. [derived: 4 cubes of 2 cells along each axis]
constexpr int kCubeBits = 6;
/// Runs of places in one block from which on places are taken as they come, in places: sorting one
/// costs a hundredth of loading a block. [free: time]
constexpr std::size_t kLongRun = 64;

/// Three numbers of row @a i.
Vec3d placeAt(const NumberView& places, std::size_t i)
{
    if (places.type == NumberView::Type::Double)
        return Eigen::Map<const Vec3d>(places.row<double>(i));
    return Eigen::Map<const Vec3f>(places.row<float>(i)).cast<double>();
}

void requireNumbers(const NumberView& places)
{
    if (places.type == NumberView::Type::Byte)
        throw UsageError("places are floats or doubles, not bytes");
    if (!places.empty() && places.columns != 3)
        throw UsageError(fmt::format("places have three numbers each, not {}", places.columns));
}

/// The distance at places of a block by its voxels' values, without triangles. For one thread.
class BlockDistance
{
public:
    explicit BlockDistance(const LevelSet& levelSet)
        : mWindow(levelSet.grid().tree(), levelSet.voxelSize()),
          mPolyhedron(levelSet.grid().tree(), levelSet.voxelSize()),
          mBand(levelSet.halfWidth() * levelSet.voxelSize())
    {
    }

    void load(const Coord& origin)
    {
        mWindow.load(origin);
        mIsSearched = false;
    }
    /// The signed distance of @a at, voxels from the block's origin, world units; none where the
    /// values do not give it. @param gradient  set if @a Sloped, unit.
    template <bool Sloped>
    std::optional<double> find(const Vec3f& at, Vec3d& gradient)
    {
        const int x = int(at[0]), y = int(at[1]), z = int(at[2]);
        double value = 0;
        if (!mWindow.isSmooth(x, y, z) && isOfPlanes(x, y, z)) {
            value = mPolyhedron.value(at.cast<double>(), gradient);
        } else if (!mWindow.canInterpolate(x, y, z)) {
            return {};
        } else if (Sloped) {
            Vec3f slope;
            value = double(mWindow.value(at, slope));
            gradient = slope.cast<double>().normalized();
        } else {
            value = double(mWindow.value(at));
        }
        // Beyond the band values are extrapolated, too far.
        if (std::abs(value) > mBand) return {};
        return value;
    }

private:
    bool isOfPlanes(int x, int y, int z)
    {
        if (!mIsSearched) mPolyhedron.load(mWindow.origin());
        mIsSearched = true;
        return mPolyhedron.explains(x, y, z);
    }

    BandWindow mWindow;
    PolyhedronDistance mPolyhedron;
    bool mIsSearched = false; ///< the block has been searched for planes
    double mBand;             ///< world units
};

} // namespace

/// What the questions share.
class Queries::Answers
{
public:
    Answers(LevelSet levelSet, FieldPtr field)
        : mLevelSet(std::move(levelSet)), mField(std::move(field)), mLattice(mLevelSet.lattice()),
          mBlocks(mLevelSet.grid().tree()), mBox(mLevelSet.bounds()),
          mIsEmpty(!hasInside(mLevelSet.grid().tree()))
    {
    }

    const LevelSet& levelSet() const { return mLevelSet; }
    bool isEmpty() const { return mIsEmpty; }

    /// Calls f(i, distance, gradient) for each place, of which the gradient is set if @a Sloped.
    template <bool Sloped, class F>
    void forEach(const NumberView& places, Interrupter& progress, const F& f) const
    {
        requireNumbers(places);
        Order order;
        std::vector<FarPlace> far, scratch;
        for (std::size_t begin = 0; begin < places.rows; begin += kBatch) {
            const Batch batch{places, begin, std::min(begin + kBatch, places.rows)};
            forEachInBand<Sloped>(batch, order, far, progress, f);
            // Many at once, as places of a cube share its triangles.
            if (far.size() < kBatch && batch.end < places.rows) continue;
            forEachFar(places, far, scratch, progress, f);
            far.clear();
        }
    }

    /// @throws as Queries::raycast().
    const SharpSurface& surface(Interrupter& progress) const
    {
        const std::scoped_lock lock(mMutex);
        // While it waits, this thread must not take up work that asks for the surface, too.
        tbb::this_task_arena::isolate([&] {
            if (!mSurface) mSurface.emplace(mLevelSet, mField.get(), progress);
        });
        return *mSurface;
    }

    /// Whether a place is inside, where a voxel beside it tells. @param at  voxels.
    static std::optional<bool> side(const BandWindow::Accessor& accessor, const Vec3d& at,
                                    double voxelSize)
    {
        /// Index from which on places are outside. [derived: half of the range of int]
        constexpr double kFarVoxel = 1 << 30;
        /// Largest distance of a place from the nearest voxel, voxels. [derived: sqrt(3) / 2,
        /// rounded up for values that are rounded]
        constexpr double kNearest = 0.87;
        if (!(at.cwiseAbs().maxCoeff() < kFarVoxel)) return false;
        const Coord voxel(int(std::lround(at[0])), int(std::lround(at[1])),
                          int(std::lround(at[2])));
        const double value = double(accessor.getValue(voxel));
        if (std::abs(value) < kNearest * voxelSize) return {};
        return value < 0;
    }

    Vec3d voxels(const Vec3d& place) const
    {
        return (place - mLattice.origin) / mLattice.voxelSize;
    }

    /// Copies of @a places, of which those that are very far are drawn towards the level set: the
    /// surface's nearest place is the same, but for roundings. None where none is as far.
    std::vector<Vec3d> drawnNear(const NumberView& places, Interrupter& progress) const
    {
        /// Distance, diagonals of the box. [derived: half of a double's bits. From there on all
        /// places of a face across are equally far, but for roundings]
        constexpr double kVeryFar = 0x1p26;
        if (mBox.isEmpty()) return {};
        const Vec3d middle = mBox.center();
        const double reach = kVeryFar * mBox.diagonal().norm();
        const auto drawn = [&](const Vec3d& place) -> Vec3d {
            const Vec3d away = place - middle;
            const double farthest = away.cwiseAbs().maxCoeff();
            if (!(farthest > reach) || !away.allFinite()) return place;
            return middle + reach * (away / farthest);
        };
        std::atomic<bool> isAnyFar{false};
        forEachParallel(places.rows, kPlaces, progress, [&](std::size_t i) {
            if ((placeAt(places, i) - middle).cwiseAbs().maxCoeff() > reach) isAnyFar = true;
        });
        if (!isAnyFar) return {};
        std::vector<Vec3d> near(places.rows);
        forEachParallel(near.size(), kPlaces, progress,
                        [&](std::size_t i) { near[i] = drawn(placeAt(places, i)); });
        return near;
    }

private:
    struct Batch {
        const NumberView& places;
        std::size_t begin, end;

        std::size_t size() const { return end - begin; }
        Vec3d place(std::size_t index) const { return placeAt(places, begin + index); }
    };

    /// A place in the band's blocks, or BandBlocks::kFar.
    struct Item {
        std::uint64_t block; ///< key
        std::uint32_t index; ///< in the batch
        Vec3f at;            ///< voxels from the block's origin
    };
    /// A batch's places by blocks, and memory for sorting. One batch leaves it to the next, as
    /// new pages are slow.
    struct Order {
        std::vector<Item> items, scratch;
    };

    Item itemOf(const Batch& batch, std::size_t index) const
    {
        Item item;
        item.block = mBlocks.find(voxels(batch.place(index)), item.at);
        item.index = std::uint32_t(index);
        return item;
    }

    /// Whether few places of a batch follow one in the same block, by some stretches of it.
    bool isScattered(const Batch& batch) const
    {
        // Looking at one place in 16 costs little beside what follows. [free: time]
        constexpr std::size_t kStretch = 512, kOf = 16 * kStretch;
        std::size_t runs = 0, seen = 0;
        for (std::size_t begin = 0; begin < batch.size(); begin += kOf) {
            std::uint64_t last = BandBlocks::kFar;
            for (std::size_t i = begin; i < std::min(begin + kStretch, batch.size()); ++i, ++seen) {
                const std::uint64_t block = itemOf(batch, i).block;
                runs += block != last;
                last = block;
            }
        }
        return runs * kLongRun > seen;
    }

    /// A place that interpolation does not answer.
    struct FarPlace {
        std::uint64_t cube; ///< key of the cube of cells that holds it, or BandBlocks::kFar
        std::size_t index;  ///< row
    };

    /// Answers what interpolation can. @param far  the places that are left are added to it.
    template <bool Sloped, class F>
    void forEachInBand(const Batch& batch, Order& order, std::vector<FarPlace>& far,
                       Interrupter& progress, const F& f) const
    {
        const auto itemAt = [&](std::size_t n) { return itemOf(batch, n); };
        if (!isScattered(batch)) {
            forEachItem<Sloped>(batch, itemAt, far, progress, f);
            return;
        }
        order.items.resize(batch.size());
        forEachParallel(batch.size(), kPlaces, progress,
                        [&](std::size_t n) { order.items[n] = itemAt(n); });
        radixSort(
            order.items, order.scratch, 0, mBlocks.bits(),
            [](const Item& item) { return item.block; }, progress);
        forEachItem<Sloped>(
            batch, [&](std::size_t n) { return order.items[n]; }, far, progress, f);
    }

    /// The same for all items of a batch in the order of @a itemAt(n).
    template <bool Sloped, class ItemAt, class F>
    void forEachItem(const Batch& batch, const ItemAt& itemAt, std::vector<FarPlace>& far,
                     Interrupter& progress, const F& f) const
    {
        std::vector<std::vector<FarPlace>> left((batch.size() + kPlaces - 1) / kPlaces); // by task
        forEachParallel(left.size(), 1, progress, [&](std::size_t task) {
            BlockDistance distance(mLevelSet);
            std::uint64_t loaded = BandBlocks::kFar;
            const std::size_t end = std::min((task + 1) * kPlaces, batch.size());
            for (std::size_t n = task * kPlaces; n < end; ++n) {
                const auto [block, index, at] = itemAt(n);
                const std::size_t row = batch.begin + index;
                if (block == BandBlocks::kFar) {
                    left[task].push_back({BandBlocks::kFar, row});
                    continue;
                }
                if (block != loaded) distance.load(mBlocks.origin(block));
                loaded = block;
                Vec3d gradient = Vec3d::Zero();
                if (const auto found = distance.template find<Sloped>(at, gradient))
                    f(row, *found, gradient);
                else
                    left[task].push_back({cubeOf(block, at), row});
            }
        });
        for (const auto& some : left) far.insert(far.end(), some.begin(), some.end());
    }

    /// The key of the cube of cells that holds @a at in a block.
    static std::uint64_t cubeOf(std::uint64_t block, const Vec3f& at)
    {
        std::uint64_t cube = block;
        for (int axis = 0; axis < 3; ++axis)
            cube = cube * (kBlockDim / kCube) + std::uint64_t(int(at[axis]) / kCube);
        return cube;
    }

    /// Answers the places that are left by the nearest triangles.
    template <class F>
    void forEachFar(const NumberView& places, std::vector<FarPlace>& far,
                    std::vector<FarPlace>& scratch, Interrupter& progress, const F& f) const
    {
        if (far.empty()) return;
        const SharpSurface* const sharp = isEmpty() ? nullptr : &surface(progress);
        radixSort(
            far, scratch, 0, mBlocks.bits() + kCubeBits,
            [](const FarPlace& place) { return place.cube; }, progress);
        const std::size_t tasks = (far.size() + kPlaces - 1) / kPlaces;
        tbb::parallel_for(std::size_t(0), tasks, [&](std::size_t task) {
            const std::size_t end = std::min((task + 1) * kPlaces, far.size());
            forEachFarOf(places, &far[task * kPlaces], end - task * kPlaces, sharp, progress, f);
        });
    }

    /// The same for @a count places in the order of their cubes. @param sharp  null without a
    /// surface.
    template <class F>
    void forEachFarOf(const NumberView& places, const FarPlace* far, std::size_t count,
                      const SharpSurface* sharp, Interrupter& progress, const F& f) const
    {
        const BandWindow::Accessor accessor(mLevelSet.grid().tree());
        SignedTriangles::Hint hint;
        std::optional<CellTriangles> gathered;
        if (sharp) gathered.emplace(sharp->triangles().tree(), kCube * mLattice.voxelSize);
        for (std::size_t n = 0; n < count;) {
            std::size_t end = n + 1; // of the cube
            while (end < count && far[end].cube == far[n].cube) ++end;
            const bool share = sharp && far[n].cube != BandBlocks::kFar && end - n >= kShared;
            if (share)
                gathered->gather(middleOfCube(far[n].cube) - sharp->triangles().mesh().frame);
            for (; n < end; ++n) {
                if (n % kFarPlaces == 0) progress.check();
                const std::size_t i = far[n].index;
                const Vec3d place = placeAt(places, i);
                if (!place.allFinite() || !sharp) {
                    f(i, sharp || !place.allFinite() ? kNaN : HUGE_VAL, Vec3d::Constant(kNaN));
                    continue;
                }
                const auto near = share ? sharp->triangles().nearest(place, *gathered)
                                        : sharp->triangles().nearest(place, hint);
                const auto inside = side(accessor, voxels(place), mLattice.voxelSize);
                const SurfaceFoot foot = sharp->nearest(place, inside, near);
                f(i, foot.distance, foot.direction);
            }
        }
    }

    /// The middle of a cube of cells, world units.
    Vec3d middleOfCube(std::uint64_t cube) const
    {
        const Coord block = mBlocks.origin(cube >> kCubeBits);
        Vec3d middle;
        for (int axis = 2; axis >= 0; --axis, cube /= kBlockDim / kCube)
            middle[axis] = block[axis] + kCube * (double(cube % (kBlockDim / kCube)) + 0.5);
        return mLattice.origin + mLattice.voxelSize * middle;
    }

    LevelSet mLevelSet;
    FieldPtr mField;
    Lattice mLattice;
    BandBlocks mBlocks;
    Box3d mBox;    ///< of the band, world units
    bool mIsEmpty; ///< without a surface
    mutable std::mutex mMutex;
    mutable std::optional<SharpSurface> mSurface;
};

Queries::Queries(LevelSet levelSet, FieldPtr field)
    : mAnswers(std::make_unique<Answers>(std::move(levelSet), std::move(field)))
{
}

Queries::~Queries() = default;

const LevelSet& Queries::levelSet() const
{
    return mAnswers->levelSet();
}

void Queries::distances(const NumberView& places, double* distances, Interrupter* interrupter) const
{
    mAnswers->forEach<false>(
        places, orSilent(interrupter),
        [&](std::size_t i, double distance, const Vec3d&) { distances[i] = distance; });
}

void Queries::distances(const NumberView& places, double* distances, Vec3d* gradients,
                        Interrupter* interrupter) const
{
    mAnswers->forEach<true>(places, orSilent(interrupter),
                            [&](std::size_t i, double distance, const Vec3d& gradient) {
                                distances[i] = distance;
                                gradients[i] = gradient;
                            });
}

void Queries::closestPoints(const NumberView& places, Vec3d* closest,
                            Interrupter* interrupter) const
{
    requireNumbers(places);
    Interrupter& progress = orSilent(interrupter);
    const std::vector<Vec3d> near = mAnswers->drawnNear(places, progress);
    const NumberView asked = near.empty() ? places : NumberView(near);
    mAnswers->forEach<true>(asked, progress,
                            [&](std::size_t i, double distance, const Vec3d& gradient) {
                                closest[i] = placeAt(asked, i) - distance * gradient;
                            });
}

void Queries::contains(const NumberView& places, std::uint8_t* inside,
                       Interrupter* interrupter) const
{
    requireNumbers(places);
    // Voxels tell nearly all; what is beside the surface is left.
    std::vector<std::vector<std::size_t>> unknown((places.rows + kPlaces - 1) / kPlaces);
    forEachParallel(unknown.size(), 1, orSilent(interrupter), [&](std::size_t task) {
        const BandWindow::Accessor accessor(levelSet().grid().tree());
        const std::size_t end = std::min((task + 1) * kPlaces, places.rows);
        for (std::size_t i = task * kPlaces; i < end; ++i) {
            const Vec3d at = mAnswers->voxels(placeAt(places, i));
            const auto side = Answers::side(accessor, at, levelSet().voxelSize());
            inside[i] = side.value_or(false);
            if (!side) unknown[task].push_back(i);
        }
    });
    std::vector<std::size_t> left;
    for (const auto& some : unknown) left.insert(left.end(), some.begin(), some.end());
    std::vector<Vec3d> near(left.size());
    for (std::size_t n = 0; n < left.size(); ++n) near[n] = placeAt(places, left[n]);
    std::vector<double> distances(left.size());
    this->distances(near, distances.data(), interrupter);
    for (std::size_t n = 0; n < left.size(); ++n) inside[left[n]] = distances[n] < 0;
}

void Queries::raycast(const NumberView& origins, const NumberView& directions, double* hits,
                      Vec3d* normals, Interrupter* interrupter) const
{
    requireNumbers(origins);
    requireNumbers(directions);
    if (origins.rows != directions.rows)
        throw UsageError(
            fmt::format("{} origins of rays, but {} directions", origins.rows, directions.rows));
    Interrupter& progress = orSilent(interrupter);
    if (origins.empty()) return;
    const SharpSurface* const sharp = mAnswers->isEmpty() ? nullptr : &mAnswers->surface(progress);
    forEachParallel(origins.rows, kFarPlaces, progress, [&](std::size_t i) {
        const Vec3d direction = placeAt(directions, i), origin = placeAt(origins, i);
        if (!direction.allFinite() || direction.isZero(0))
            throw UsageError(fmt::format("the direction of ray {} is zero or not finite", i));
        Vec3d normal = Vec3d::Constant(kNaN);
        hits[i] =
            sharp && origin.allFinite() ? sharp->firstHit(origin, direction, normal) : HUGE_VAL;
        if (normals) normals[i] = normal;
    });
}

} // namespace mpuvdb
