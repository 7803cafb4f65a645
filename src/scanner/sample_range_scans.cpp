#include "core/random.h"
#include "line_tracer.h"
#include "surface_sampling.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>

namespace mpuvdb
{
namespace
{

/// Viewpoints spread evenly over a sphere [Gonzalez10: Fibonacci lattice].
std::vector<Vec3d> spreadViewpoints(const Box3d& box, int views)
{
    constexpr double kDistance = 3; // radii of the bounding sphere [tuned: scan_sampler_test]
    const double radius = kDistance * box.diagonal().norm() / 2;
    const double goldenAngle = M_PI * (3 - std::sqrt(5.0));
    std::vector<Vec3d> points;
    for (int i = 0; i < views; ++i) {
        const double z = 1 - (2 * i + 1) / double(views), r = std::sqrt(1 - z * z);
        const Vec3d direction(r * std::cos(goldenAngle * i), r * std::sin(goldenAngle * i), z);
        points.push_back(box.center() + radius * direction);
    }
    return points;
}

/// A pinhole camera that sees the bounding sphere.
class Camera
{
public:
    Camera(const Vec3d& eye, const Box3d& box) : mEye(eye)
    {
        const Vec3d toMiddle = box.center() - eye;
        const double away = toMiddle.norm(), radius = box.diagonal().norm() / 2;
        mForward = away > 0 ? Vec3d(toMiddle / away) : Vec3d::UnitZ();
        mSide = tangents(mForward);
        // From within the sphere the camera sees 75 degrees to each side. [tuned:
        // scan_sampler_test]
        constexpr double kMaxAngle = 75 * M_PI / 180;
        mHalfWidth =
            std::tan(radius < away ? std::min(std::asin(radius / away), kMaxAngle) : kMaxAngle);
    }

    const Vec3d& eye() const { return mEye; }
    /// The direction of pixel (row, column) of size x size pixels.
    Vec3d ray(int row, int column, int size) const
    {
        const double x = mHalfWidth * ((2 * column + 1) / double(size) - 1);
        const double y = mHalfWidth * ((2 * row + 1) / double(size) - 1);
        return (mForward + mSide * Eigen::Vector2d(x, y)).normalized();
    }
    /// The angle between neighboring rays, radians; approximate.
    double pixelAngle(int size) const { return 2 * mHalfWidth / size; }

private:
    Vec3d mEye, mForward;
    Eigen::Matrix<double, 3, 2> mSide;
    double mHalfWidth;
};

/// Depth along the ray per pixel; 0 where the ray hits nothing.
struct RangeImage {
    int size = 0;
    std::vector<double> depth;

    double at(int row, int column) const
    {
        const bool inside = row >= 0 && column >= 0 && row < size && column < size;
        return inside ? depth[std::size_t(row) * size + column] : 0;
    }
    std::size_t hits() const
    {
        return depth.size() - std::size_t(std::count(depth.begin(), depth.end(), 0.0));
    }
};

RangeImage takeImage(const LineTracer& tracer, const Camera& camera, int size,
                     Interrupter& progress)
{
    RangeImage image{size, std::vector<double>(std::size_t(size) * size, 0.0)};
    tbb::parallel_for(0, size, [&](int row) {
        for (int column = 0; column < size; ++column) {
            if (column % 256 == 0) progress.check();
            const auto hit = tracer.firstHit(camera.eye(), camera.ray(row, column, size));
            if (hit) image.depth[std::size_t(row) * size + column] = *hit;
        }
    });
    return image;
}

/// The width, in pixels, of the borders where confidence falls. [tuned: scan_sampler_test]
constexpr int kBorderWidth = 4;

/// The distance, in pixels, to the nearest hole or jump in depth: from 1 to kBorderWidth.
std::vector<std::uint8_t> borderDistances(const RangeImage& image, double pixelAngle)
{
    constexpr double kJump = 5; // of depth, in pixels' widths [derived: a slope of 80 degrees]
    const auto isBorder = [&](int row, int column) {
        const double depth = image.at(row, column), jump = kJump * pixelAngle * depth;
        for (const auto& [r, c] : {std::pair(row - 1, column), std::pair(row + 1, column),
                                   std::pair(row, column - 1), std::pair(row, column + 1)}) {
            const double other = image.at(r, c);
            if (other == 0 || std::abs(other - depth) > jump) return true;
        }
        return false;
    };
    std::vector<std::uint8_t> distance(image.depth.size(), kBorderWidth);
    const auto at = [&](int row, int column) -> std::uint8_t& {
        return distance[std::size_t(row) * image.size + column];
    };
    for (int row = 0; row < image.size; ++row)
        for (int column = 0; column < image.size; ++column)
            if (isBorder(row, column)) at(row, column) = 1;
    const auto relax = [&](int row, int column, int r, int c) {
        if (r < 0 || c < 0 || r >= image.size || c >= image.size) return;
        at(row, column) = std::uint8_t(std::min(int(at(row, column)), at(r, c) + 1));
    };
    // City-block distances in two sweeps [Rosenfeld66].
    for (int row = 0; row < image.size; ++row)
        for (int column = 0; column < image.size; ++column) {
            relax(row, column, row - 1, column);
            relax(row, column, row, column - 1);
        }
    for (int row = image.size - 1; row >= 0; --row)
        for (int column = image.size - 1; column >= 0; --column) {
            relax(row, column, row + 1, column);
            relax(row, column, row, column + 1);
        }
    return distance;
}

void appendImage(const Solid& solid, const Camera& camera, const RangeImage& image,
                 RangeScans& scans)
{
    const auto borders = borderDistances(image, camera.pixelAngle(image.size));
    for (int row = 0; row < image.size; ++row) {
        for (int column = 0; column < image.size; ++column) {
            const double depth = image.at(row, column);
            if (depth == 0) continue;
            const Vec3d ray = camera.ray(row, column, image.size);
            const Vec3d position = camera.eye() + depth * ray;
            const Vec3d normal = solid.normal(position);
            const double inner =
                double(borders[std::size_t(row) * image.size + column]) / kBorderWidth;
            scans.points.push_back({position, normal.cast<float>()});
            scans.rays.push_back(ray.cast<float>());
            scans.confidence.push_back(float(std::max(-normal.dot(ray) * inner, 0.01)));
        }
    }
}

/// The pixels along an image's side with which all images together have about @a points points.
int imageSize(const LineTracer& tracer, const std::vector<Camera>& cameras, std::uint64_t points,
              Interrupter& progress)
{
    constexpr int kTrial = 64;      // pixels of the image that hits are counted in [tuned: time]
    constexpr int kMaxSize = 30000; // pixels [tuned: an image takes 7 GB]
    std::size_t hits = 0;
    for (const Camera& camera : cameras) hits += takeImage(tracer, camera, kTrial, progress).hits();
    if (hits == 0)
        throw InputError("sample: the solid is not seen from the viewpoints. Move them, or leave "
                         "them to --views");
    const double size = kTrial * std::sqrt(double(points) / double(hits));
    return int(std::clamp(std::lround(size), 1l, long(kMaxSize)));
}

} // namespace

RangeScans sampleRangeScans(const Solid& solid, const ScanSettings& settings, Interrupter& progress)
{
    const Box3d box = solid.bounds();
    const LineTracer tracer(solid);
    std::vector<Camera> cameras;
    for (const Vec3d& eye : settings.viewpoints.empty() ? spreadViewpoints(box, settings.views)
                                                        : settings.viewpoints) {
        if (!(solid.distance(eye) > 0))
            throw UsageError(fmt::format("sample: viewpoint ({}, {}, {}) lies inside the solid. "
                                         "Move it out",
                                         eye.x(), eye.y(), eye.z()));
        cameras.emplace_back(eye, box);
    }
    const int size = imageSize(tracer, cameras, settings.points, progress);
    RangeScans scans;
    for (const Camera& camera : cameras)
        appendImage(solid, camera, takeImage(tracer, camera, size, progress), scans);
    return scans;
}

} // namespace mpuvdb
