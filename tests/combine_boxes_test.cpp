// Booleans of boxes beside exact distances, faces of two in one plane among them.
#include "combine_fixture.h"

namespace mpuvdb::test
{
namespace
{

/// Boxes along the axes.
struct Box {
    Vec3d low, high;
    bool holds(const Vec3d& p) const
    {
        return (p.array() > low.array()).all() && (p.array() < high.array()).all();
    }
    std::string text() const
    {
        const Vec3d s = high - low, c = 0.5 * (low + high);
        return fmt::format("translate(box({}, {}, {}), {}, {}, {})", s[0], s[1], s[2], c[0], c[1],
                           c[2]);
    }
};

/// The planes of all boxes cut space into cells that are inside or outside as a whole; the distance
/// is that to the nearest cell of the other kind.
Exact boxesDistance(const std::vector<Box>& boxes, const std::function<bool(const Vec3d&)>& inside)
{
    std::vector<double> planes[3];
    for (int axis = 0; axis < 3; ++axis) {
        planes[axis] = {-100, 100};
        for (const Box& box : boxes)
            planes[axis].insert(planes[axis].end(), {box.low[axis], box.high[axis]});
        std::sort(planes[axis].begin(), planes[axis].end());
    }
    std::vector<Box> cells[2];
    for (std::size_t x = 1; x < planes[0].size(); ++x)
        for (std::size_t y = 1; y < planes[1].size(); ++y)
            for (std::size_t z = 1; z < planes[2].size(); ++z) {
                const Box cell{{planes[0][x - 1], planes[1][y - 1], planes[2][z - 1]},
                               {planes[0][x], planes[1][y], planes[2][z]}};
                if ((cell.high - cell.low).minCoeff() > 0)
                    cells[inside(0.5 * (cell.low + cell.high))].push_back(cell);
            }
    return [cellsOut = cells[0], cellsIn = cells[1], inside](const Vec3d& p) {
        const auto nearest = [&](const std::vector<Box>& of) {
            double d2 = HUGE_VAL;
            for (const Box& c : of)
                d2 = std::min(d2, (c.low - p).cwiseMax(p - c.high).cwiseMax(0.0).squaredNorm());
            return std::sqrt(d2);
        };
        return nearest(cellsIn) - nearest(cellsOut);
    };
}

TEST(Combine, GivesDistancesInBoxesThatCross)
{
    const double h = 1.0 / 24;
    const std::vector<Box> boxes = {{{-0.61, -0.43, -0.52}, {0.4, 0.52, 0.5}},
                                    {{-0.2, -0.17, -0.13}, {0.83, 0.75, 0.31}},
                                    {{-0.71, 0.21, -0.3}, {-0.05, 0.8, 0.72}}};
    const LevelSet a = solidLevelSet(boxes[0].text(), h), b = solidLevelSet(boxes[1].text(), h),
                   c = solidLevelSet(boxes[2].text(), h);
    const auto in = [&](std::size_t n, const Vec3d& p) { return boxes[n].holds(p); };
    const std::vector<std::pair<LevelSet, std::function<bool(const Vec3d&)>>> cases = {
        {a | b, [&](const Vec3d& p) { return in(0, p) || in(1, p); }},
        {a & b, [&](const Vec3d& p) { return in(0, p) && in(1, p); }},
        {a - b, [&](const Vec3d& p) { return in(0, p) && !in(1, p); }},
        {combined(Boolean::Union, {a, b, c}),
         [&](const Vec3d& p) { return in(0, p) || in(1, p) || in(2, p); }},
        {combined(Boolean::Difference, {a, b, c}),
         [&](const Vec3d& p) { return in(0, p) && !in(1, p) && !in(2, p); }}};
    for (const auto& [result, inside] : cases) {
        expectNear(result, boxesDistance(boxes, inside), 1.1, 0.01, 0.3);
        expectSoundCreases(result);
    }
}

TEST(Combine, FusesBoxesThatTouch)
{
    const double h = 1.0 / 16;
    // On voxels, between voxels, and where decimals round.
    for (const double x : {0.0, 0.3 * h, 0.1 + 0.2}) {
        SCOPED_TRACE(x);
        const Box a{{-0.7, -0.5, -0.5}, {x, 0.5, 0.5}}, b{{x, -0.5, -0.5}, {0.8, 0.5, 0.5}};
        const LevelSet both = solidLevelSet(a.text(), h) | solidLevelSet(b.text(), h);
        const Box whole{a.low, b.high};
        expectNear(both, boxesDistance({whole}, [&](const Vec3d& p) { return whole.holds(p); }),
                   1.1, 0.005, 0.05);
        expectSoundCreases(both);
        const LevelSet cut = solidLevelSet(whole.text(), h) - solidLevelSet(b.text(), h);
        expectNear(cut, boxesDistance({a}, [&](const Vec3d& p) { return a.holds(p); }), 1.1, 0.005,
                   0.05);
        expectSoundCreases(cut);
    }
}

/// Off the lattice, as faces of users' solids are.
constexpr double kOff[3] = {0.013, 0.017, 0.019};

Box offLattice(const Vec3d& low, const Vec3d& high)
{
    const Vec3d off(kOff[0], kOff[1], kOff[2]);
    return {low + off, high + off};
}

/// Faces of two solids in one plane do as well as others.
TEST(Combine, FacesInOnePlaneAreExact)
{
    const double h = 1.0 / 20;
    const Box body = offLattice({-1, -0.5, -0.5}, {1, 0.5, 0.5});
    const std::vector<std::pair<Boolean, Box>> cases = {
        {Boolean::Difference, offLattice({0, -0.5, -0.5}, {1, 0.5, 0.5})},
        {Boolean::Difference, offLattice({0, -0.5, -1}, {1.3, 0.5, 1})},
        {Boolean::Difference, offLattice({-0.5, 0, -1}, {0.5, 0.5, 1})},
        {Boolean::Difference, offLattice({0, -0.1, -0.5}, {1, 0.5, 0.5})},
        {Boolean::Union, offLattice({1, -0.5, -0.5}, {1.4, 0.5, 0.5})},
        {Boolean::Union, offLattice({1, -0.5, -0.5}, {1.4, 0, 0.5})},
        {Boolean::Union, offLattice({-0.3, 0.5, -0.5}, {0.3, 1, 0.5})},
        {Boolean::Intersection, offLattice({-0.3, -0.5, -0.5}, {1.4, 0.5, 0.5})},
        {Boolean::Intersection, offLattice({-0.3, -0.5, -1}, {1.4, 0.5, 0.1})}};
    for (const auto& [kind, box] : cases) {
        SCOPED_TRACE(fmt::format("{} with {}", int(kind), box.text()));
        const auto inside = [&, k = kind, other = box](const Vec3d& p) {
            const bool a = body.holds(p), b = other.holds(p);
            return k == Boolean::Union ? a || b : k == Boolean::Difference ? a && !b : a && b;
        };
        const LevelSet result =
            combined(kind, {solidLevelSet(body.text(), h), solidLevelSet(box.text(), h)});
        expectNear(result, boxesDistance({body, box}, inside), 1.7, 0.001, 0.05);
        expectSoundCreases(result);
    }
}

/// A box between random ones of six planes along each axis: two of them share planes as a rule.
Box randomBox(Random& random)
{
    constexpr double kPlanes[6] = {-0.7, -0.4, -0.15, 0.1, 0.4, 0.7};
    Vec3d low, high;
    for (int axis = 0; axis < 3; ++axis) {
        const auto first = std::size_t(random.uniform(0, 5));
        const auto second = first + 1 + std::size_t(random.uniform(0, 5.0 - double(first)));
        low[axis] = kPlanes[first];
        high[axis] = kPlanes[second];
    }
    return offLattice(low, high);
}

/// Single voxels may be off where three or more faces meet; no more than one in ten thousand.
TEST(Combine, RandomBoxesThatSharePlanesAreNearlyExact)
{
    const double h = 1.0 / 20;
    std::uint64_t voxels = 0, wrong = 0, off = 0;
    double squares = 0;
    for (std::uint64_t seed = 1; seed <= 60; ++seed) {
        Random random(seed);
        const double turn = seed % 2 == 0 ? 0 : random.uniform(10, 80);
        const Vec3d axis = Vec3d(random.uniform(-1, 1), random.uniform(-1, 1), 1).normalized();
        const std::vector<Box> boxes = {randomBox(random), randomBox(random)};
        const auto kind = Boolean(int(random.uniform(0, 3)));
        const auto inside = [&](const Vec3d& p) {
            const bool a = boxes[0].holds(p), b = boxes[1].holds(p);
            return kind == Boolean::Union ? a || b : kind == Boolean::Difference ? a && !b : a && b;
        };
        const Exact straight = boxesDistance(boxes, inside);
        const Eigen::Matrix3d back = Eigen::AngleAxisd(-turn * M_PI / 180, axis).toRotationMatrix();
        const auto turned = [&](const Box& box) {
            return solidLevelSet(
                fmt::format("rotate({},{},{},{},{})", box.text(), axis[0], axis[1], axis[2], turn),
                h);
        };
        const LevelSet result = combined(kind, {turned(boxes[0]), turned(boxes[1])});
        if (result.grid().activeVoxelCount() == 0) continue;
        SCOPED_TRACE(fmt::format("seed {}", seed));
        expectSoundCreases(result);
        for (auto on = result.grid().cbeginValueOn(); on; ++on) {
            const double d = straight(back * worldOf(result.lattice(), on.getCoord())) / h;
            const double value = double(*on) / h, error = std::abs(value - d);
            ++voxels;
            squares += error * error;
            off += error > 0.3;
            wrong += (d < 0) != (value < 0) && std::abs(d) > 0.05;
        }
    }
    EXPECT_GT(voxels, 200000u);
    EXPECT_EQ(wrong, 0u);
    EXPECT_LE(std::sqrt(squares / double(voxels)), 0.003);
    EXPECT_LE(double(off), 1e-4 * double(voxels)) << off << " of " << voxels;
    if (std::getenv("MPUVDB_TEST_FIGURES"))
        fmt::print("  rms {:.5f}, {} of {} off by more than 0.3\n",
                   std::sqrt(squares / double(voxels)), off, voxels);
}

} // namespace
} // namespace mpuvdb::test
