#include "picture.h"
#include "png_image.h"
#include "query/sharp_surface.h"
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/queries.h>

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <vector>

namespace mpuvdb
{
namespace
{

using openvdb::FloatGrid;
namespace fs = std::filesystem;

constexpr double kPi = 3.14159265358979323846; ///< [derived: pi]
constexpr int kSamples = 2;                    ///< rays per pixel and axis [tuned: picture_test]

/// The boxes of the voxels beside the zero set, one for each leaf, world units.
std::vector<Box3d> surfaceBoxes(const FloatGrid& grid, double voxelSize,
                                const Interrupter& progress)
{
    std::vector<Box3d> boxes;
    for (auto leaf = grid.tree().cbeginLeaf(); leaf; ++leaf) {
        progress.check();
        Box3d box;
        for (auto value = leaf->cbeginValueOn(); value; ++value)
            if (std::abs(*value) < voxelSize) {
                const openvdb::Coord at = value.getCoord();
                box.extend(voxelSize * Vec3d(at.x(), at.y(), at.z()));
            }
        if (!box.isEmpty()) boxes.push_back(box);
    }
    if (boxes.empty()) boxes.emplace_back(Vec3d::Constant(-voxelSize), Vec3d::Constant(voxelSize));
    return boxes;
}

/// A perspective camera that frames some boxes.
class Camera
{
public:
    Camera(const std::vector<Box3d>& boxes, const PictureSettings& settings)
    {
        const double azimuth = settings.azimuth * kPi / 180;
        // Straight above or below, "up" is undefined.
        const double elevation = std::clamp(settings.elevation, -89.9, 89.9) * kPi / 180;
        const bool isZUp = settings.up == UpAxis::Z;
        mSky = isZUp ? Vec3d::UnitZ() : Vec3d::UnitY();
        const Vec3d front = isZUp ? Vec3d(-Vec3d::UnitY()) : Vec3d(Vec3d::UnitZ());
        mBack =
            std::cos(elevation) * (std::sin(azimuth) * Vec3d::UnitX() + std::cos(azimuth) * front) +
            std::sin(elevation) * mSky;
        mRight = mSky.cross(mBack).normalized();
        mUp = mBack.cross(mRight);
        // Half of the field of view, and its size in those of the boxes. [tuned: picture_test]
        constexpr double kHalfAngle = 15 * kPi / 180, kMargin = 1.1;
        const double aspect = double(settings.width) / settings.height;
        mTanX = std::tan(kHalfAngle) * std::max(1.0, aspect);
        mTanY = std::tan(kHalfAngle) * std::max(1.0, 1 / aspect);

        const auto forEachCorner = [&](const auto& visit) {
            for (const Box3d& box : boxes)
                for (int corner = 0; corner < 8; ++corner) {
                    const Vec3d c = box.corner(static_cast<Box3d::CornerType>(corner));
                    visit(Vec3d(c.dot(mRight), c.dot(mUp), c.dot(mBack)));
                }
        };
        Box3d seen; // along right, up and back
        forEachCorner([&](const Vec3d& c) { seen.extend(c); });
        const Vec3d center = seen.center();
        double distance = 0;
        forEachCorner([&](const Vec3d& c) {
            const Vec3d d = c - center;
            distance = std::max({distance, d.z() + kMargin * std::abs(d.x()) / mTanX,
                                 d.z() + kMargin * std::abs(d.y()) / mTanY});
        });
        mEye = center.x() * mRight + center.y() * mUp + (center.z() + distance) * mBack;
    }

    const Vec3d& eye() const { return mEye; }
    /// The direction that points up in the world.
    const Vec3d& sky() const { return mSky; }
    /// @param x, y  in [-1,1], from left to right and from bottom to top.
    Vec3d direction(double x, double y) const
    {
        return (x * mTanX * mRight + y * mTanY * mUp - mBack).normalized();
    }
    /// A direction given from the viewer's right, top and back.
    Vec3d fromView(const Vec3d& v) const
    {
        return (v.x() * mRight + v.y() * mUp + v.z() * mBack).normalized();
    }

private:
    Vec3d mEye, mRight, mUp, mBack, mSky;
    double mTanX, mTanY;
};

/// White above, gray below; linear light.
Vec3d background(double y)
{
    const double t = 0.5 + 0.5 * y;
    return Vec3d::Constant(0.48 + 0.47 * t);
}

/// Neutral clay under a key light from the upper left, a cool fill from the right and the sky.
class Clay
{
public:
    explicit Clay(const Camera& camera)
        : mKey(camera.fromView({-0.55, 0.75, 0.65})), mFill(camera.fromView({0.9, 0.1, 0.45})),
          mSky(camera.sky())
    {
    }

    const Vec3d& key() const { return mKey; }
    Vec3d shade(const Vec3d& normal, const Vec3d& view, bool lit) const
    {
        const double sky = 0.5 + 0.5 * normal.dot(mSky);
        const double key = lit ? std::max(0.0, normal.dot(mKey)) : 0;
        const double fill = std::max(0.0, normal.dot(mFill));
        const double gloss =
            lit ? 0.10 * std::pow(std::max(0.0, normal.dot((mKey - view).normalized())), 30) : 0;
        const Vec3d light = key * Vec3d(0.72, 0.70, 0.66) + fill * Vec3d(0.13, 0.15, 0.18) +
                            (0.07 + 0.15 * sky) * Vec3d(0.94, 0.98, 1.05);
        return 0.78 * light + Vec3d::Constant(gloss);
    }

private:
    Vec3d mKey, mFill, mSky;
};

std::uint8_t encode(double linear)
{
    const double v = std::clamp(linear, 0.0, 1.0);
    const double srgb = v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1 / 2.4) - 0.055;
    return std::uint8_t(std::lround(255 * srgb));
}

/// Paints the surface's mesh, which keeps edges sharp and thin walls whole.
class Painter
{
public:
    /// @param levelSet  near the origin.
    Painter(const LevelSet& levelSet, const Camera& camera, Interrupter& progress)
        : mCamera(camera), mClay(camera), mVoxelSize(levelSet.voxelSize()), mSurface(levelSet),
          mProgress(progress)
    {
        // So that the surface is extracted now, in a stage of its own.
        trace({camera.eye()}, {camera.direction(0, 0)});
    }

    /// Paint some rows of pixels.
    void paint(Image& image, int firstRow, int endRow) const
    {
        std::vector<Ray> rays = raysOf(image, firstRow, endRow);
        std::vector<Vec3d> origins(rays.size(), mCamera.eye()), directions;
        for (const Ray& ray : rays) directions.push_back(ray.view);
        const Hits seen = trace(origins, directions);
        std::vector<std::size_t> met; // rays that meet the surface
        origins.clear();
        for (std::size_t n = 0; n < rays.size(); ++n) {
            if (!std::isfinite(seen.at[n])) continue;
            Ray& ray = rays[n];
            ray.normal = seen.normals[n];
            if (!(ray.normal.squaredNorm() > 0)) ray.normal = -ray.view;
            // Open or broken grids show their inner side.
            if (ray.normal.dot(ray.view) > 0) ray.normal = -ray.normal;
            // The shadow's ray starts off the surface, so as not to find it again.
            origins.emplace_back(mCamera.eye() + seen.at[n] * ray.view +
                                 1.5 * mVoxelSize * ray.normal);
            met.push_back(n);
        }
        const Hits shadows = trace(origins, std::vector<Vec3d>(origins.size(), mClay.key()));
        for (std::size_t k = 0; k < met.size(); ++k)
            rays[met[k]].color =
                mClay.shade(rays[met[k]].normal, rays[met[k]].view, !std::isfinite(shadows.at[k]));
        fill(image, firstRow, endRow, rays);
    }

private:
    struct Ray {
        Vec3d view, normal, color;
    };
    struct Hits {
        std::vector<double> at; ///< along the rays; infinite: none
        std::vector<Vec3d> normals;
    };

    Hits trace(const std::vector<Vec3d>& origins, const std::vector<Vec3d>& directions) const
    {
        Hits hits{std::vector<double>(origins.size()), std::vector<Vec3d>(origins.size())};
        mSurface.raycast(origins, directions, hits.at.data(), hits.normals.data(), &mProgress);
        return hits;
    }

    /// The rays of the rows' pixels, with the background's color.
    std::vector<Ray> raysOf(const Image& image, int firstRow, int endRow) const
    {
        std::vector<Ray> rays;
        for (int row = kSamples * firstRow; row < kSamples * endRow; ++row)
            for (int column = 0; column < kSamples * image.width; ++column) {
                const double x = 2 * (column + 0.5) / (kSamples * image.width) - 1,
                             y = 1 - 2 * (row + 0.5) / (kSamples * image.height);
                rays.push_back({mCamera.direction(x, y), Vec3d::Zero(), background(y)});
            }
        return rays;
    }

    static void fill(Image& image, int firstRow, int endRow, const std::vector<Ray>& rays)
    {
        const int perRow = kSamples * image.width;
        for (int row = firstRow; row < endRow; ++row)
            for (int column = 0; column < image.width; ++column) {
                Vec3d sum = Vec3d::Zero();
                for (int sy = 0; sy < kSamples; ++sy)
                    for (int sx = 0; sx < kSamples; ++sx)
                        sum += rays[std::size_t(kSamples * (row - firstRow) + sy) * perRow +
                                    std::size_t(kSamples * column + sx)]
                                   .color;
                std::uint8_t* const pixel =
                    &image.rgb[3 * (std::size_t(row) * image.width + column)];
                for (int channel = 0; channel < 3; ++channel)
                    pixel[channel] = encode(sum[channel] / (kSamples * kSamples));
            }
    }

    const Camera& mCamera;
    Clay mClay;
    double mVoxelSize;
    Queries mSurface;
    Interrupter& mProgress;
};

Image render(const LevelSet& levelSet, const PictureSettings& settings, Interrupter& progress)
{
    constexpr int kRows = 8; ///< rows of pixels at a time [free: memory and response time]
    // Without the translation coordinates are small, however far from the origin the grid is.
    const double h = levelSet.voxelSize();
    const auto voxels =
        openvdb::gridConstPtrCast<FloatGrid>(levelSet.grid().copyReplacingMetadataAndTransform(
            levelSet.grid(), openvdb::math::Transform::createLinearTransform(h)));
    const Camera camera(surfaceBoxes(*voxels, h, progress), settings);
    const Painter painter(LevelSet(voxels), camera, progress);
    Image image{settings.width, settings.height, {}};
    image.rgb.resize(std::size_t(3) * settings.width * settings.height);
    progress.beginStage("render", settings.height);
    for (int row = 0; row < settings.height; row += kRows) {
        const int end = std::min(row + kRows, settings.height);
        painter.paint(image, row, end);
        progress.advance(end - row);
    }
    progress.endStage();
    return image;
}

/// @throws LimitError where the surface's triangles take more than @a maxBytes.
void requireMemory(const LevelSet& levelSet, std::uint64_t maxBytes, const Interrupter& progress)
{
    if (maxBytes == 0) return;
    const std::uint64_t bytes = SharpSurface::bytesFor(levelSet, progress);
    if (bytes <= maxBytes) return;
    // Surfaces grow with the square of the resolution.
    const double larger = std::sqrt(double(bytes) / double(maxBytes));
    throw LimitError(fmt::format("the surface's mesh needs about {:.0f} MB, more than the "
                                 "{:.0f} MB that are left: resample to voxels of {:.3g}, or raise "
                                 "--max-memory",
                                 double(bytes) / 1e6, double(maxBytes) / 1e6,
                                 1.05 * larger * levelSet.voxelSize()));
}

void requireRange(const char* name, double value, double low, double high)
{
    if (!(value >= low && value <= high))
        throw UsageError(
            fmt::format("picture: {} is {}, and must be in [{}, {}]", name, value, low, high));
}

} // namespace

void writePicture(const fs::path& file, const LevelSet& levelSet, const PictureSettings& settings,
                  Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    requireRange("width", settings.width, 16, 8192);
    requireRange("height", settings.height, 16, 8192);
    requireRange("azimuth", settings.azimuth, -360, 360);
    requireRange("elevation", settings.elevation, -90, 90);
    requireMemory(levelSet, settings.maxBytes, progress);
    const Image image = render(levelSet, settings, progress);
    writePng(file, image, progress);
}

} // namespace mpuvdb
