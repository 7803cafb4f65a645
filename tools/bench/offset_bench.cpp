// What an offset and a re-distancing cost and how exact they are, beside OpenVDB's own:
//     offset_bench MESH|GRID.vdb [VOXELS [ACROSS [alone]]]
// of a closed mesh ACROSS voxels long, by VOXELS of them; "alone" leaves OpenVDB's out. Prints
// JSON. Errors are against the distance to the nearest of all triangles: the mesh's own, of a grid
// those that openvdb::tools::volumeToMesh makes of it.
#include "timing.h"

#include "spatial/triangle_tree.h"
#include <mpuvdb/interrupter.h>
#include <mpuvdb/io.h>
#include <mpuvdb/mesh.h>
#include <mpuvdb/operations.h>

#include <openvdb/tools/LevelSetFilter.h>
#include <openvdb/tools/LevelSetRebuild.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>

using openvdb::Coord;
using openvdb::FloatGrid;

namespace
{

/// One voxel in so many is compared.
constexpr int kEvery = 8;
/// Slopes of the exact distance by which it may differ from 1: more is near the medial axis.
constexpr double kRegular = 0.03;

/// Distances to a mesh, found by searching all of it.
class Exact
{
public:
    Exact(const mpuvdb::Mesh& mesh, const openvdb::math::Transform& transform,
          mpuvdb::Interrupter& progress)
        : mTree(mesh, progress), mFrame(mesh.frame), mTransform(transform)
    {
    }

    /// In voxels. @param slot  see TriangleTree.
    double at(const Coord& voxel, std::size_t& slot) const
    {
        const openvdb::Vec3d p = mTransform.indexToWorld(voxel);
        const mpuvdb::Vec3d place = mpuvdb::Vec3d(p.x(), p.y(), p.z()) - mFrame;
        return std::sqrt(mTree.squaredDistance(place, slot)) / mTransform.voxelSize()[0];
    }

private:
    mpuvdb::TriangleTree mTree;
    mpuvdb::Vec3d mFrame;
    openvdb::math::Transform mTransform;
};

/// How far, in voxels, the values of one leaf are from @a exact minus @a shift voxels. Behind
/// creases of an offset the nearest place on it is another: voxels on the side from which it came
/// do not count, nor do those near the medial axis.
class Errors
{
public:
    Errors(const FloatGrid& grid, const Exact& exact, double shift)
        : mAccess(grid.getConstAccessor()), mExact(exact), mSize(grid.voxelSize()[0]), mShift(shift)
    {
    }

    template <typename Leaf>
    void add(const Leaf& leaf, std::size_t number, std::vector<float>& errors)
    {
        for (auto value = leaf.cbeginValueOn(); value; ++value) {
            if ((value.pos() ^ number) % kEvery != 0 || *value * mShift < 0) continue;
            const Coord at = value.getCoord();
            if (isRegular(at))
                errors.push_back(float(std::abs(*value / mSize + mShift - signedAt(at))));
        }
    }

private:
    double signedAt(const Coord& at)
    {
        return std::copysign(mExact.at(at, mSlot), mAccess.getValue(at) / mSize + mShift);
    }

    bool isRegular(const Coord& at)
    {
        double sum = 0;
        for (int axis = 0; axis < 3; ++axis) {
            Coord low = at, high = at;
            low[axis] -= 1;
            high[axis] += 1;
            const double slope = (signedAt(high) - signedAt(low)) / 2;
            sum += slope * slope;
        }
        return std::abs(std::sqrt(sum) - 1) < kRegular;
    }

    FloatGrid::ConstAccessor mAccess;
    const Exact& mExact;
    double mSize, mShift;
    std::size_t mSlot = 0;
};

void printErrors(const char* name, const FloatGrid& grid, const Exact& exact, double shift,
                 double seconds)
{
    std::vector<const openvdb::FloatTree::LeafNodeType*> leaves;
    grid.tree().getNodes(leaves);
    tbb::enumerable_thread_specific<std::vector<float>> perThread;
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, leaves.size(), 64),
                      [&](const tbb::blocked_range<std::size_t>& range) {
                          Errors errors(grid, exact, shift);
                          for (std::size_t n = range.begin(); n < range.end(); ++n)
                              errors.add(*leaves[n], n, perThread.local());
                      });
    std::vector<float> errors;
    for (const auto& part : perThread) errors.insert(errors.end(), part.begin(), part.end());
    if (errors.empty()) throw std::runtime_error(std::string(name) + ": nothing to compare");
    std::sort(errors.begin(), errors.end());
    double sum = 0;
    for (const float e : errors) sum += double(e);
    const auto share = [&](double part) {
        return double(errors[std::size_t(part * double(errors.size() - 1))]);
    };
    std::printf("  \"%s\": {\"cpu_seconds\": %.3f, \"active_voxels\": %llu, \"compared\": %zu, "
                "\"mean_error\": %.5f, \"p99\": %.4f, \"p99.9\": %.4f, \"p99.99\": %.4f, "
                "\"max_error\": %.4f}",
                name, seconds, static_cast<unsigned long long>(grid.activeVoxelCount()),
                errors.size(), sum / double(errors.size()), share(0.99), share(0.999),
                share(0.9999), share(1));
    std::fflush(stdout);
}

template <typename F>
void run(const char* name, const Exact& exact, double shift, F f)
{
    bench::Times times;
    FloatGrid::ConstPtr result;
    times.add([&] { result = f(); });
    printErrors(name, *result, exact, shift, times.cpu.front());
}

mpuvdb::LevelSet voxelized(const mpuvdb::Mesh& mesh, double across, mpuvdb::Interrupter& progress)
{
    mpuvdb::Box3d box;
    for (std::size_t n = 0; n < mesh.positions.size(); ++n) box.extend(mesh.world(n));
    mpuvdb::SampleSettings settings;
    settings.lattice.voxelSize = box.sizes().maxCoeff() / across;
    return mpuvdb::voxelize(mesh, settings, &progress);
}

bool isGrid(const std::string& path)
{
    return path.size() > 4 && path.compare(path.size() - 4, 4, ".vdb") == 0;
}

void compare(const std::string& path, double voxels, double across, bool alone)
{
    mpuvdb::Interrupter progress;
    const mpuvdb::Mesh given = isGrid(path) ? mpuvdb::Mesh() : mpuvdb::readMesh(path, &progress);
    const mpuvdb::LevelSet levelSet =
        isGrid(path) ? mpuvdb::LevelSet(bench::readGrid(path)) : voxelized(given, across, progress);
    const FloatGrid& grid = levelSet.grid();
    const double distance = voxels * levelSet.voxelSize();
    const Exact exact(isGrid(path) ? mpuvdb::extractMesh(levelSet, {}, &progress) : given,
                      grid.transform(), progress);
    std::printf("{\n");
    run("offset", exact, voxels,
        [&] { return mpuvdb::offset(levelSet, distance, &progress).gridPtr(); });
    const double halfWidth = levelSet.halfWidth();
    std::printf(",\n");
    run("redistance", exact, 0,
        [&] { return mpuvdb::redistance(grid, halfWidth, &progress).gridPtr(); });
    if (!alone) {
        std::printf(",\n");
        run("levelSetRebuild", exact, 0, [&] {
            return openvdb::tools::levelSetRebuild(grid, 0.0f, float(halfWidth), float(halfWidth));
        });
        std::printf(",\n");
        run("LevelSetFilter::offset", exact, voxels, [&] {
            FloatGrid::Ptr moved = grid.deepCopy();
            openvdb::tools::LevelSetFilter<FloatGrid>(*moved).offset(float(-distance));
            return moved;
        });
    }
    std::printf("\n}\n");
}

} // namespace

int main(int count, char** arguments)
try {
    if (count < 2 || count > 5) {
        std::fprintf(stderr, "usage: %s MESH|GRID.vdb [VOXELS [ACROSS [alone]]]\n", arguments[0]);
        return 2;
    }
    openvdb::initialize();
    compare(arguments[1], count > 2 ? std::atof(arguments[2]) : 20,
            count > 3 ? std::atof(arguments[3]) : 512, count > 4);
    return 0;
} catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
