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

/// The fewest points that are examined. [tuned: rounded_positions_test]
constexpr std::size_t kMinPoints = 100;
/// The points that determine the step of an axis. [tuned: rounded_positions_test]
constexpr std::uint64_t kStepSample = 1 << 14;
/// The points that are sorted into cubes. [tuned: rounded_positions_test]
constexpr std::uint64_t kCubeSample = 1 << 16;
/// The fewest values of a coordinate that has steps. [derived: two equal gaps]
constexpr std::size_t kMinValues = 3;
/// The cubes along an axis. [derived: indices of two axes fit 64 bits]
constexpr std::uint64_t kCubesPerAxis = 1 << 30;

/// An axis's coordinates: first + whole numbers * size.
struct Steps {
    double first = 0, size = 0; ///< world units
};

/// About kStepSample values of an axis, sorted.
std::vector<double> sampleOf(const FilePoints& points, int axis)
{
    const std::uint64_t every = points.size() / kStepSample + 1;
    std::vector<double> values;
    std::uint64_t n = 0;
    for (const PointBlock& block : points.blocks)
        for (const Vec3d& p : block.positions)
            if (n++ % every == 0) values.push_back(p[axis]);
    std::sort(values.begin(), values.end());
    return values;
}

/// The steps whose multiples all but a few of the gaps between an axis's sorted values are.
std::optional<Steps> stepsOf(std::vector<double> values)
{
    // The deviation of a gap from a multiple, in steps, and the share of gaps within it.
    // [derived: random gaps are within it once in 25; outliers may spoil some]
    constexpr double kMaxDeviation = 0.02, kMinShare = 0.98;
    constexpr double kMaxGap = 8; // steps [tuned: rounded_positions_test]
    values.erase(std::unique(values.begin(), values.end()), values.end());
    if (values.size() < kMinValues) return std::nullopt;
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
        if (steps > kMaxGap) break;
        whole += std::round(steps) >= 1 && std::abs(steps - std::round(steps)) < kMaxDeviation;
        ++asked;
    }
    if (whole < kMinShare * asked) return std::nullopt;
    return Steps{values[values.size() / 2], size};
}

/// A cube of one step in a layer of points with equal coordinates along an axis.
struct Cube {
    /// The parts of its face along an edge. [derived: a curve through the face meets seven of 16 at
    /// most, two parallel ones eight, and sixteen random points ten]
    static constexpr unsigned kAcross = 4;

    std::uint64_t column = 0; ///< position across the axis
    std::int64_t layer = 0;   ///< position along it
    std::uint32_t points = 0;
    std::uint32_t parts = 0; ///< bits of the face's parts that hold points

    /// Whether its points spread over the face, as on no curve.
    bool isFilled() const
    {
        // The fewest points, and the most parts that curves meet. [derived: see kAcross]
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

/// Columns of cubes between two values of one coordinate, and of those one in `every`.
struct Columns {
    double from = -std::numeric_limits<double>::infinity();
    double to = std::numeric_limits<double>::infinity();
    std::uint64_t every = 1;
};

/// Columns about the middle of an axis that hold about kCubeSample of the points.
Columns someColumns(std::uint64_t points, const std::vector<double>& sample, double origin,
                    double step)
{
    Columns columns;
    if (points <= kCubeSample) return columns;
    const double half = 0.5 * double(kCubeSample) / double(points);
    const double last = double(sample.size() - 1);
    const auto at = [&](double share) { return sample[std::size_t(share * last)]; };
    columns.from = origin + std::floor((at(0.5 - half) - origin) / step) * step;
    columns.to = origin + (std::floor((at(0.5 + half) - origin) / step) + 1) * step;
    const auto found = std::count_if(sample.begin(), sample.end(),
                                     [&](double x) { return x >= columns.from && x < columns.to; });
    const double inThem = double(found) / double(sample.size()) * double(points);
    columns.every = std::uint64_t(inThem / double(kCubeSample)) + 1;
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
                    std::clamp((p[a] - origin[a]) / steps.size + 0.5 * double(kCubesPerAxis), 0.0,
                               double(kCubesPerAxis));
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

/// The mean number of points in a filled cube; 0 where it is no rounding: too few points lie in
/// areas, or in less than three layers (a plate has two faces), or within a solid.
double pointsPerFilled(const std::vector<Cube>& cubes)
{
    // The fewest layers and filled cubes. [derived: a plate has two faces;
    // tuned: rounded_positions_test]
    constexpr std::size_t kMinLayers = 3, kMinCubes = 8;
    // The least share of points in filled cubes. [derived: of all directions, those within 45
    // degrees of an axis, where a layer is wider than a step, are 1 - cos 45 = 0.29; a third may be
    // missing where layers end]
    constexpr double kMinFilled = 0.2;
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
        if (layers.size() < kMinLayers) layers.insert(cubes[i].layer);
    }
    const bool isRounded =
        within > kMinFilled * all && layers.size() >= kMinLayers && count >= kMinCubes;
    return isRounded ? within / double(count) : 0;
}

/// The mean number of points in a cube; 0 where no more than points a step apart have. It means
/// rounding where another axis has steps as coarse, so that a cube's points lie on a few places or
/// lines, and where the steps are those of floats, which slices never have.
double pointsPerCube(const std::vector<Cube>& cubes)
{
    constexpr double kMinPerCube = 4; // [derived: a spacing of half a step]
    double points = 0;
    for (const Cube& cube : cubes) points += cube.points;
    const double perCube = points / double(std::max<std::size_t>(cubes.size(), 1));
    return perCube >= kMinPerCube ? perCube : 0;
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

std::optional<std::string> findRounding(const FilePoints& points, Interrupter& progress)
{
    if (points.size() < kMinPoints) return std::nullopt;
    std::array<std::optional<Steps>, 3> steps;
    std::array<std::vector<double>, 3> samples;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        progress.check();
        samples[axis] = sampleOf(points, int(axis));
        steps[axis] = stepsOf(samples[axis]);
    }
    // Triangles' corners that are not shared have equal positions.
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
    if (coarsest == 0) return std::nullopt;
    std::vector<std::string> named;
    for (int axis = 0; axis < 3; ++axis)
        if (const auto& own = steps[std::size_t(axis)]; own && own->size > 0.5 * spacing)
            named.push_back(fmt::format("{:.4g} in {}", own->size, "xyz"[axis]));
    return fmt::format(
        "its positions were rounded to steps of {}, and its points are about {:.2g} apart: the "
        "surface will show the steps. {}",
        fmt::join(named, " and "), spacing,
        ofFloats ? "That is what floats of 32 bits leave so far from the origin: subtract an "
                   "offset from the coordinates before they are written, or write doubles"
                 : "Write them with more decimals (LAS: with a smaller scale), or, where they are "
                   "floats of 32 bits, with an offset subtracted before");
}

} // namespace mpuvdb
