// Colors of points on grids: what they take beside everything else, and how near they come.
//     attributes_bench [FILE...]
// of clouds with colors, or of virtual ones: closed and open, noisy, and inside out, so that the
// surface is far from points.
// Prints JSON: the share of a run's CPU time (reading left out) that Cd takes, with what it adds to
// writing and without ("grid"), medians of five runs at the default voxel size and at 400 voxels;
// and of virtual balls the rms errors of colors that change evenly, and of waves of ten spacings,
// and the part of a deviation from point to point that is left.
#include "timing.h"

#include <mpuvdb/clean.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/io.h>
#include <mpuvdb/reconstruct.h>
#include <mpuvdb/scan_sampler.h>

#include <fmt/format.h>

#include <cmath>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <functional>
#include <random>
#include <string>
#include <vector>

using namespace mpuvdb;

namespace
{

constexpr std::uint64_t kPoints = 48000;

using ValueAt = std::function<double(const Vec3d&)>;

PointCloud sampled(const std::string& solid, ScanSettings::Pattern pattern, double noise)
{
    ScanSettings settings;
    settings.points = kPoints;
    settings.pattern = pattern;
    settings.noise = noise;
    Interrupter progress;
    PointCloud cloud = scan(*parseSolid(solid), settings, &progress);
    for (std::size_t n = 0; n < cloud.size(); ++n) {
        const Vec3d p = cloud.frame + cloud.positions[n].cast<double>();
        const Vec3d c = (127.5 + 100 * (3 * p).array().sin()).round();
        cloud.colors.push_back({std::uint8_t(c[0]), std::uint8_t(c[1]), std::uint8_t(c[2])});
    }
    return cloud;
}

/// Those below @a height, which leaves a bowl.
PointCloud below(const PointCloud& whole, float height)
{
    PointCloud part;
    part.frame = whole.frame;
    for (std::size_t n = 0; n < whole.size(); ++n) {
        if (whole.positions[n][2] > height) continue;
        part.positions.push_back(whole.positions[n]);
        part.normals.push_back(whole.normals[n]);
        part.colors.push_back(whole.colors[n]);
    }
    return part;
}

PointCloud turned(PointCloud cloud)
{
    for (Vec3f& normal : cloud.normals) normal = -normal;
    return cloud;
}

/// CPU seconds of a run's parts.
struct Parts {
    double surface = 0, grid = 0, file = 0;

    double share() const { return (grid + file) / (surface + grid + file); }
};

Parts run(const PointCloud& given, std::optional<double> voxels, bool keepNormals)
{
    Interrupter progress;
    const auto file = std::filesystem::temp_directory_path() /
                      fmt::format("attributes_bench_{}.vdb", std::random_device()());
    bench::Times surface, grid, plain, colored;
    {
        PointCloud cloud = given;
        std::optional<ReconstructResult> made;
        surface.add([&] {
            ReconstructOptions options;
            if (keepNormals) options.clean->normals = NormalsFrom::Keep;
            options.voxels = voxels;
            options.attributes = {kColorName};
            FittedPoints fitted =
                fitPoints(preparePoints(std::move(cloud), options, &progress), &progress);
            fitted.options.attributes.clear(); // they are sampled below
            made.emplace(sampleFit(fitted, &progress));
        });
        openvdb::GridCPtrVec colors;
        std::unique_ptr<const SurfaceAttributes> attributes;
        grid.add([&] {
            attributes = made->field->attributes({kColorName});
            colors = compressAttributes(made->levelSet(), *attributes, &progress);
        });
        plain.add([&] { writeLevelSet(file, made->levelSet(), {}, {}, &progress); });
        colored.add([&] { writeLevelSet(file, made->levelSet(), {}, colors, &progress); });
    }
    std::filesystem::remove(file);
    const double without = plain.cpu[0];
    return {surface.cpu[0] + without, grid.cpu[0], colored.cpu[0] - without};
}

std::string timed(const std::string& name, const PointCloud& cloud, bool keepNormals = false)
{
    std::string line = fmt::format(R"(  {{"cloud": "{}", "points": {})", name, cloud.size());
    for (const bool fine : {false, true}) {
        std::vector<double> shares, grids;
        for (int n = 0; n < 5; ++n) {
            const Parts parts =
                run(cloud, fine ? std::optional<double>(400) : std::nullopt, keepNormals);
            shares.push_back(parts.share());
            grids.push_back(parts.grid / (parts.surface + parts.grid + parts.file));
        }
        line += fmt::format(R"(, "{}": {{"share": {:.3f}, "grid": {:.3f}}})",
                            fine ? "400 voxels" : "default", bench::median(shares),
                            bench::median(grids));
    }
    return line + "}";
}

/// The rms difference from @a value, on directions all around, of what a ball's points have.
double rmsOf(ScanSettings::Pattern pattern, const ValueAt& value, double deviation)
{
    constexpr int kPlaces = 20000;
    PointCloud cloud = sampled("sphere(1)", pattern, 0);
    cloud.colors.clear();
    std::mt19937 random(1);
    std::normal_distribution<double> normal;
    NamedScalars scalars{"value", {}};
    for (std::size_t n = 0; n < cloud.size(); ++n) {
        const Vec3d p = cloud.frame + cloud.positions[n].cast<double>();
        scalars.values.push_back(float(value(p) + deviation * normal(random)));
    }
    cloud.scalars = {scalars};
    MpuSettings fit;
    fit.tolerance = 0.001;
    fit.voxelSize = 0.016;
    Interrupter progress;
    const MpuField field(std::move(cloud), fit, &progress);
    std::vector<SurfacePlace> places;
    for (int n = 0; n < kPlaces; ++n) {
        const Vec3d at = Vec3d(normal(random), normal(random), normal(random)).normalized();
        places.push_back({at, at});
    }
    std::vector<float> found;
    field.attributes({"value"})->evaluate(places, found);
    double squares = 0;
    for (std::size_t n = 0; n < places.size(); ++n)
        squares += std::pow(double(found[n]) - value(places[n].position), 2);
    return std::sqrt(squares / double(places.size()));
}

std::string errors(const char* name, ScanSettings::Pattern pattern)
{
    const double spacing = std::sqrt(4 * M_PI / double(kPoints)), turn = 2 * M_PI / (10 * spacing);
    const auto even = [](const Vec3d& p) { return 0.5 + 0.5 * p[0]; };
    const auto wave = [&](const Vec3d& p) { return std::sin(turn * p[2]) * std::sqrt(2.0); };
    return fmt::format(R"(  {{"points": "{}", "even": {:.5f}, "waves": {:.3f}, "left": {:.3f}}})",
                       name, rmsOf(pattern, even, 0), rmsOf(pattern, wave, 0),
                       rmsOf(
                           pattern, [](const Vec3d&) { return 0.0; }, 1));
}

} // namespace

int main(int argc, char** argv)
{
    openvdb::initialize();
    using Pattern = ScanSettings::Pattern;
    try {
        std::vector<std::string> lines;
        Interrupter progress;
        for (int n = 1; n < argc; ++n)
            lines.push_back(
                timed(argv[n], readPoints({argv[n]}, BadPoints::Drop, {}, {}, &progress).cloud));
        if (argc < 2) {
            const PointCloud ball = sampled("sphere(1)", Pattern::Random, 0),
                             torus = sampled("torus(1, 0.4)", Pattern::Random, 0);
            lines = {timed("ball", ball),
                     timed("torus", torus),
                     timed("blob, noisy", sampled("blob(1, 12, 0.1)", Pattern::Scan, 0.01)),
                     timed("torus, inside out", turned(torus), true),
                     timed("half a ball", below(ball, 0)),
                     timed("half a ball, inside out", turned(below(ball, 0)), true),
                     errors("random", Pattern::Random),
                     errors("even", Pattern::Even)};
        }
        const char* separator = "[\n";
        for (const std::string& line : lines) {
            fmt::print("{}{}", separator, line);
            separator = ",\n";
        }
        fmt::print("\n]\n");
    } catch (const std::exception& error) {
        fmt::print(stderr, "attributes_bench: {}\n", error.what());
        return 1;
    }
}
