// Questions to level sets beside OpenVDB's BoxSampler: time of distances, and their errors.
// query_bench [million places] [grid.vdb]; JSON on standard output.
#include "timing.h"

#include <mpuvdb/fields.h>
#include <mpuvdb/queries.h>
#include <mpuvdb/sampling.h>
#include <mpuvdb/scan_sampler.h>
#include <mpuvdb/shape.h>

#include <fmt/format.h>
#include <openvdb/tools/Interpolation.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <cmath>
#include <cstdlib>
#include <functional>
#include <random>

namespace
{

using namespace mpuvdb;
using Distance = std::function<double(const Vec3d&)>;

constexpr int kRuns = 3;

/// A level set on voxels of 1, and its exact distance, if that is known.
struct Case {
    std::string name;
    LevelSet levelSet;
    Distance exact;
};

double cylinderDistance(const Vec3d& p, double radius, double half)
{
    const double beside = std::hypot(p[0], p[1]) - radius, above = std::abs(p[2]) - half;
    return std::hypot(std::max(beside, 0.0), std::max(above, 0.0)) +
           std::min(0.0, std::max(beside, above));
}

double boxDistance(const Vec3d& p, const Vec3d& half)
{
    const Vec3d d = p.cwiseAbs() - half;
    return d.cwiseMax(0).norm() + std::min(0.0, d.maxCoeff());
}

std::vector<Case> cases()
{
    std::vector<Case> all;
    const auto add = [&](const std::string& name, const Shape& shape, Distance exact) {
        all.push_back({name, shape.evaluate({1, 3, 0}), std::move(exact)});
    };
    const auto solid = [](const std::string& text) {
        return Shape(makeSolidField(parseSolid(text)), text);
    };
    const Vec3d middle(0.3, 0.1, 0.2);
    for (const double radius : {5.0, 10.0, 20.0, 60.0, 200.0})
        add(fmt::format("ball of {}", radius),
            solid(fmt::format("sphere({})", radius))
                .moved(Eigen::Affine3d(Eigen::Translation3d(middle))),
            [=](const Vec3d& p) { return (p - middle).norm() - radius; });
    Eigen::Affine3d turn(Eigen::AngleAxisd(0.7, Vec3d(1, 2, 3).normalized()));
    turn.pretranslate(middle);
    const Vec3d half(60, 40, 30);
    add("turned box", solid("box(120,80,60)").moved(turn),
        [=](const Vec3d& p) { return boxDistance(turn.inverse() * p, half); });
    add("turned cylinder", solid("cylinder(30,80)").moved(turn),
        [=](const Vec3d& p) { return cylinderDistance(turn.inverse() * p, 30, 40); });
    return all;
}

/// Places up to @a reach voxels from the centers of active voxels that are within @a band of the
/// surface, in random order.
std::vector<Vec3d> placesBeside(const LevelSet& levelSet, double band, std::size_t count)
{
    std::vector<openvdb::Coord> voxels;
    for (auto it = levelSet.grid().cbeginValueOn(); it; ++it)
        if (std::abs(double(*it)) < band * levelSet.voxelSize()) voxels.push_back(it.getCoord());
    std::mt19937_64 random(7);
    std::uniform_real_distribution<double> shift(-0.5, 0.5);
    const Lattice lattice = levelSet.lattice();
    std::vector<Vec3d> places;
    places.reserve(count);
    for (std::size_t n = 0; n < count; ++n) {
        const openvdb::Coord& at = voxels[random() % voxels.size()];
        places.push_back(lattice.origin +
                         lattice.voxelSize * (Vec3d(at[0], at[1], at[2]) +
                                              Vec3d(shift(random), shift(random), shift(random))));
    }
    return places;
}

void boxSample(const openvdb::FloatGrid& grid, const std::vector<Vec3d>& places,
               std::vector<double>& values)
{
    constexpr std::size_t kGrain = 8192;
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, places.size(), kGrain),
                      [&](const auto& range) {
                          const auto accessor = grid.getConstAccessor();
                          const openvdb::tools::GridSampler<openvdb::FloatGrid::ConstAccessor,
                                                            openvdb::tools::BoxSampler>
                              sampler(accessor, grid.transform());
                          for (std::size_t n = range.begin(); n < range.end(); ++n) {
                              const Vec3d& p = places[n];
                              values[n] = double(sampler.wsSample({p[0], p[1], p[2]}));
                          }
                      });
}

std::string errors(const std::vector<Vec3d>& places, const std::vector<double>& values,
                   const Distance& exact)
{
    if (!exact) return "null";
    std::vector<double> all;
    double sum = 0;
    for (std::size_t n = 0; n < places.size(); ++n) {
        all.push_back(std::abs(values[n] - exact(places[n])));
        sum += all.back();
    }
    std::sort(all.begin(), all.end());
    return fmt::format("{{\"mean\": {:.3g}, \"p99\": {:.3g}, \"p99.9\": {:.3g}, \"max\": {:.3g}}}",
                       sum / double(all.size()), all[all.size() * 99 / 100],
                       all[all.size() * 999 / 1000], all.back());
}

void report(const Case& one, const char* order, const std::vector<Vec3d>& places, bool isLast)
{
    std::vector<double> ours(places.size()), theirs(places.size());
    bench::Times first, again, box;
    for (int run = 0; run < kRuns; ++run) {
        const Queries queries(one.levelSet);
        first.add([&] { queries.distances(places, ours.data()); });
        again.add([&] { queries.distances(places, ours.data()); });
        box.add([&] { boxSample(one.levelSet.grid(), places, theirs); });
    }
    fmt::print("  {{\"solid\": \"{}\", \"order\": \"{}\", \"places\": {},\n"
               "   \"cpu\": {:.3f}, \"cpu again\": {:.3f}, \"box sampler\": {:.3f},\n"
               "   \"wall\": {:.3f}, \"wall again\": {:.3f}, \"box sampler wall\": {:.3f},\n"
               "   \"errors\": {},\n   \"errors of box sampler\": {}}}{}\n",
               one.name, order, places.size(), bench::median(first.cpu), bench::median(again.cpu),
               bench::median(box.cpu), bench::median(first.wall), bench::median(again.wall),
               bench::median(box.wall), errors(places, ours, one.exact),
               errors(places, theirs, one.exact), isLast ? "" : ",");
}

} // namespace

int main(int argc, char** argv)
{
    openvdb::initialize();
    const auto count = std::size_t(1e6 * (argc > 1 ? std::atof(argv[1]) : 10));
    std::vector<Case> all;
    if (argc > 2) {
        all.push_back({argv[2], LevelSet(bench::readGrid(argv[2])), {}});
    } else {
        all = cases();
    }
    fmt::print("[\n");
    for (std::size_t n = 0; n < all.size(); ++n) {
        std::vector<Vec3d> places = placesBeside(all[n].levelSet, 2, count);
        report(all[n], "random", places, false);
        std::sort(places.begin(), places.end(), [](const Vec3d& a, const Vec3d& b) {
            const auto block = [](const Vec3d& p) {
                return std::array<int, 3>{int(std::floor(p[0] / 8)), int(std::floor(p[1] / 8)),
                                          int(std::floor(p[2] / 8))};
            };
            return block(a) < block(b);
        });
        report(all[n], "by block", places, n + 1 == all.size());
    }
    fmt::print("]\n");
}
