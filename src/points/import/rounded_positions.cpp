#include "rounded_positions.h"

#include <mpuvdb/interrupter.h>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <set>

namespace mpuvdb
{
namespace
{

constexpr std::size_t kFewest = 100;              ///< points: fewer say nothing
constexpr std::uint64_t kSample = 1 << 14;        ///< points that tell the step of an axis
constexpr std::uint64_t kLookedAt = 1 << 16;      ///< points that are put into cubes
constexpr std::size_t kFewestValues = 3;          ///< of a coordinate that has steps
constexpr std::uint64_t kPlacesPerAxis = 1 << 30; ///< of cubes that are told apart

/// Where an axis's coordinates lie: first + whole numbers * size.
struct Steps {
    double first = 0, size = 0; ///< world units
};

/// Every so manyth value of an axis, sorted.
std::vector<double> sampleOf(const FilePoints& points, int axis)
{
    const std::uint64_t every = points.size() / kSample + 1;
    std::vector<double> values;
    std::uint64_t n = 0;
    for (const PointBlock& block : points.blocks)
        for (const Vec3d& p : block.positions)
            if (n++ % every == 0) values.push_back(p[axis]);
    std::sort(values.begin(), values.end());
    return values;
}

/// The steps that all but a few of the gaps between an axis's sorted values are whole numbers of.
std::optional<Steps> stepsOf(std::vector<double> values)
{
    // Of a step; of the gaps, of which outliers may spoil some. [derived: gaps at random within a
    // step are so near to whole ones once in 25]
    constexpr double kWhole = 0.02, kShare = 0.98;
    constexpr double kFar = 8; // steps: wider gaps know no more
    values.erase(std::unique(values.begin(), values.end()), values.end());
    if (values.size() < kFewestValues) return std::nullopt;
    std::vector<double> gaps(values.size() - 1);
    for (std::size_t i = 0; i < gaps.size(); ++i) gaps[i] = values[i + 1] - values[i];
    std::sort(gaps.begin(), gaps.end());
    const double likely = gaps[gaps.size() / 10];
    double sum = 0, count = 0;
    for (const double gap : gaps)
        if (gap > 0.5 * likely && gap < 1.5 * likely) {
            sum += gap;
            ++count;
        }
    const double size = sum / count;
    double whole = 0, asked = 0;
    for (const double gap : gaps) {
        const double steps = gap / size;
        if (steps > kFar) break;
        whole += std::round(steps) >= 1 && std::abs(steps - std::round(steps)) < kWhole;
        ++asked;
    }
    if (whole < kShare * asked) return std::nullopt;
    return Steps{values[values.size() / 2], size};
}

/// A cube of one step on a layer of points: those of an axis's coordinate are equal in it.
struct Cube {
    static constexpr unsigned kAcross = 4; ///< parts of its face along either edge

    std::uint64_t column = 0; ///< where it is across the axis
    std::int64_t layer = 0;   ///< and along it
    std::uint32_t points = 0;
    std::uint32_t parts = 0; ///< bits: those of its face that hold points

    /// Whether its points spread over the face, as on no curve. [derived: four parts an edge, so
    /// that a curve through the face meets seven at most, and two that run side by side eight;
    /// sixteen points at random meet ten]
    bool isFilled() const
    {
        constexpr std::uint32_t kPoints = kAcross * kAcross, kParts = 2 * kAcross;
        return points >= kPoints && std::uint32_t(__builtin_popcount(parts)) > kParts;
    }
    bool isBefore(const Cube& other, std::int64_t layers) const
    {
        return column == other.column && layer + layers == other.layer;
    }
};

std::uint64_t scrambled(std::uint64_t key)
{
    key = (key ^ (key >> 31)) * 0x9e3779b97f4a7c15ull;
    return key ^ (key >> 29);
}

/// Columns of cubes, whole ones: between two values of one coordinate, and of those every so
/// manyth.
struct Columns {
    double from = -std::numeric_limits<double>::infinity();
    double to = std::numeric_limits<double>::infinity();
    std::uint64_t every = 1;
};

/// Columns about the middle of an axis that hold some kLookedAt of the points.
Columns someColumns(std::uint64_t points, const std::vector<double>& sample, double origin,
                    double step)
{
    Columns columns;
    if (points <= kLookedAt) return columns;
    const double half = 0.5 * double(kLookedAt) / double(points);
    const double last = double(sample.size() - 1);
    const auto at = [&](double share) { return sample[std::size_t(share * last)]; };
    columns.from = origin + std::floor((at(0.5 - half) - origin) / step) * step;
    columns.to = origin + (std::floor((at(0.5 + half) - origin) / step) + 1) * step;
    const auto found = std::count_if(sample.begin(), sample.end(),
                                     [&](double x) { return x >= columns.from && x < columns.to; });
    const double inThem = double(found) / double(sample.size()) * double(points);
    columns.every = std::uint64_t(inThem / double(kLookedAt)) + 1;
    return columns;
}

/// The cubes along @a axis of some columns, by column and layer.
std::vector<Cube> cubesOf(const FilePoints& points, int axis, const Steps& steps,
                          const std::vector<double>& sampleAcross, Interrupter& progress)
{
    const int across[2] = {(axis + 1) % 3, (axis + 2) % 3};
    const Vec3d origin = points.blocks.front().positions.front();
    const Columns columns = someColumns(points.size(), sampleAcross, origin[across[0]], steps.size);
    std::vector<Cube> cubes;
    for (const PointBlock& block : points.blocks) {
        progress.check();
        for (const Vec3d& p : block.positions) {
            if (!(p[across[0]] >= columns.from && p[across[0]] < columns.to)) continue;
            Cube cube;
            std::uint32_t part = 0;
            for (const int a : across) {
                const double at =
                    std::clamp((p[a] - origin[a]) / steps.size + 0.5 * double(kPlacesPerAxis), 0.0,
                               double(kPlacesPerAxis));
                const double whole = std::floor(at);
                cube.column = cube.column << 32 | std::uint64_t(whole);
                part = part * Cube::kAcross + std::uint32_t((at - whole) * Cube::kAcross);
            }
            if (scrambled(cube.column) % columns.every != 0) continue;
            cube.layer = std::llround((p[axis] - steps.first) / steps.size);
            cube.points = 1;
            cube.parts = 1u << part;
            cubes.push_back(cube);
        }
    }
    std::sort(cubes.begin(), cubes.end(), [](const Cube& a, const Cube& b) {
        return a.column != b.column ? a.column < b.column : a.layer < b.layer;
    });
    std::size_t last = 0;
    for (std::size_t i = 1; i < cubes.size(); ++i)
        if (cubes[last].isBefore(cubes[i], 0)) {
            cubes[last].points += cubes[i].points;
            cubes[last].parts |= cubes[i].parts;
        } else {
            cubes[++last] = cubes[i];
        }
    cubes.resize(cubes.empty() ? 0 : last + 1);
    return cubes;
}

/// Points in a cube that layers' areas fill, on the average; 0 where it is no rounding: too few
/// points lie in areas, or in less than three layers (a plate has two faces), or within a solid.
double pointsPerFilled(const std::vector<Cube>& cubes)
{
    constexpr std::size_t kLayers = 3, kCubes = 8;
    // [derived: of a surface that looks in all directions the share that lies within 45 degrees of
    // an axis's planes, where a layer's area is as wide as a step, is 1 - cos 45 = 0.29; a third of
    // it may be lost where layers end]
    constexpr double kShare = 0.2;
    double all = 0, within = 0;
    std::size_t count = 0;
    std::set<std::int64_t> layers;
    for (std::size_t i = 0; i < cubes.size(); ++i) {
        all += cubes[i].points;
        if (!cubes[i].isFilled()) continue;
        const bool isOfSolid = i > 0 && i + 1 < cubes.size() &&
                               cubes[i - 1].isBefore(cubes[i], 1) && cubes[i - 1].isFilled() &&
                               cubes[i].isBefore(cubes[i + 1], 1) && cubes[i + 1].isFilled();
        if (isOfSolid) continue;
        within += cubes[i].points;
        ++count;
        if (layers.size() < kLayers) layers.insert(cubes[i].layer);
    }
    const bool isRounded = within > kShare * all && layers.size() >= kLayers && count >= kCubes;
    return isRounded ? within / double(count) : 0;
}

/// Points in a cube; 0 where there are no more than points with a step between them would have.
/// That is rounding where another axis has steps as coarse, so that a cube's points lie on a few
/// places or lines, and where the steps are those of floats: no slices have such numbers.
double pointsPerCube(const std::vector<Cube>& cubes)
{
    constexpr double kMost = 4; // [derived: spacing half of a step]
    double points = 0;
    for (const Cube& cube : cubes) points += cube.points;
    const double perCube = points / double(std::max<std::size_t>(cubes.size(), 1));
    return perCube >= kMost ? perCube : 0;
}

/// Whether the steps are those of floats: a power of two, at places that need all their bits.
bool isOfFloats(const Steps& steps)
{
    int exponent = 0;
    const bool isPower = std::frexp(steps.size, &exponent) == 0.5;
    const double bits = std::log2(std::max(std::abs(steps.first), steps.size) / steps.size);
    return isPower && bits > 22 && bits < 24.1;
}

} // namespace

std::vector<std::string> findRounding(const FilePoints& points, Interrupter& progress)
{
    if (points.size() < kFewest) return {};
    std::array<std::optional<Steps>, 3> steps;
    std::array<std::vector<double>, 3> samples;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        progress.check();
        samples[axis] = sampleOf(points, int(axis));
        steps[axis] = stepsOf(samples[axis]);
    }
    // Corners that triangles do not share lie on one place each.
    const bool isMesh = !points.triangles.empty() || points.meshTriangles > 0;
    double coarsest = 0, spacing = 0;
    bool ofFloats = false;
    for (int axis = 0; axis < 3; ++axis) {
        const auto& own = steps[std::size_t(axis)];
        if (!own) continue;
        const bool hasOther = std::any_of(steps.begin(), steps.end(), [&](const auto& other) {
            return &other != &own && other && other->size >= 0.5 * own->size;
        });
        const std::vector<Cube> cubes =
            cubesOf(points, axis, *own, samples[std::size_t(axis + 1) % 3], progress);
        double each = pointsPerFilled(cubes);
        if (each == 0 && (hasOther || isOfFloats(*own)) && !isMesh) each = pointsPerCube(cubes);
        if (each == 0) continue;
        ofFloats |= isOfFloats(*own);
        if (own->size < coarsest) continue;
        coarsest = own->size;
        spacing = own->size / std::sqrt(each);
    }
    if (coarsest == 0) return {};
    std::vector<std::string> named;
    for (int axis = 0; axis < 3; ++axis)
        if (const auto& own = steps[std::size_t(axis)]; own && own->size > 0.5 * spacing)
            named.push_back(fmt::format("{:.4g} in {}", own->size, "xyz"[axis]));
    return {fmt::format(
        "its positions were rounded to steps of {}, and its points are about {:.2g} apart: the "
        "surface will show the steps. {}",
        fmt::join(named, " and "), spacing,
        ofFloats ? "That is what floats of 32 bits leave so far from the origin: subtract an "
                   "offset from the coordinates before they are written, or write doubles"
                 : "Write them with more decimals (LAS: with a smaller scale), or, where they are "
                   "floats of 32 bits, with an offset subtracted before")};
}

} // namespace mpuvdb
