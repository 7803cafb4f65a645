// Faces with more than three corners: cut within them, and the same way wherever they begin.
#include "field_fixture.h"
#include "io_fixture.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <set>

namespace mpuvdb::test
{
namespace
{

using Ring = std::vector<Vec3d>;

Vec3d areaOf(const Ring& ring)
{
    Vec3d area = Vec3d::Zero();
    for (std::size_t k = 0; k < ring.size(); ++k)
        area += ring[k].cross(ring[(k + 1) % ring.size()]) / 2;
    return area;
}

/// A plane polygon about the origin that turns inward at many corners.
Ring ragged(int corners, Random& random)
{
    const Vec3d u = random.direction();
    const Vec3d v = u.unitOrthogonal();
    Ring ring;
    for (int k = 0; k < corners; ++k) {
        const double angle = 2 * M_PI * k / corners, radius = random.uniform(0.2, 1);
        ring.push_back(radius * (std::cos(angle) * u + std::sin(angle) * v));
    }
    return ring;
}

class PolygonTest : public IoTest
{
protected:
    /// The triangles of a face, read from a file of a format, by their corners.
    Mesh cut(const Ring& ring, const std::string& format) const
    {
        const std::size_t n = ring.size();
        std::string bytes, face;
        if (format == "off") bytes = fmt::format("OFF\n{} 1 0\n", n);
        if (format == "ply")
            bytes = fmt::format("ply\nformat ascii 1.0\nelement vertex {}\nproperty double x\n"
                                "property double y\nproperty double z\nelement face 1\n"
                                "property list int int vertex_indices\nend_header\n",
                                n);
        for (const Vec3d& p : ring)
            bytes += fmt::format("{}{} {} {}\n", format == "obj" ? "v " : "", p[0], p[1], p[2]);
        bytes += format == "obj" ? "f" : std::to_string(n);
        for (std::size_t k = 0; k < n; ++k)
            bytes += fmt::format(" {}", format == "obj" ? k + 1 : k);
        return readMesh(put("face." + format, bytes + "\n"));
    }
    /// Positions of the corners of each triangle, in an order of their own.
    static std::set<std::vector<std::array<float, 3>>> trianglesOf(const Mesh& mesh)
    {
        std::set<std::vector<std::array<float, 3>>> triangles;
        for (const Mesh::Triangle& t : mesh.triangles) {
            std::vector<std::array<float, 3>> corners;
            for (const std::uint32_t corner : t) {
                const Vec3f& p = mesh.positions[corner];
                corners.push_back({p[0], p[1], p[2]});
            }
            std::sort(corners.begin(), corners.end());
            triangles.insert(corners);
        }
        return triangles;
    }
};

TEST_F(PolygonTest, TrianglesLieWithinAndDependOnTheCornersAlone)
{
    constexpr std::uint64_t kSeed = 11;
    SCOPED_TRACE(fmt::format("seed {}", kSeed));
    Random random(kSeed);
    for (int run = 0; run < 60; ++run) {
        Ring ring = ragged(4 + run % 30, random);
        const Vec3d area = areaOf(ring);
        std::set<std::vector<std::array<float, 3>>> first;
        for (int turn = 0; turn < 4; ++turn) {
            const Mesh mesh = cut(ring, std::array{"obj", "off", "ply"}[std::size_t(turn % 3)]);
            ASSERT_EQ(mesh.triangles.size(), ring.size() - 2);
            double sum = 0; // of areas, which is the polygon's if none overlap
            const Vec3d normal = (turn % 2 == 0 ? area : Vec3d(-area)).normalized();
            for (const Mesh::Triangle& t : mesh.triangles) {
                const Vec3d a = mesh.world(t[0]), b = mesh.world(t[1]), c = mesh.world(t[2]);
                const double part = (b - a).cross(c - a).dot(normal) / 2;
                EXPECT_GT(part, -1e-6) << ring.size() << " corners, turn " << turn;
                sum += std::abs(part);
            }
            EXPECT_NEAR(sum, area.norm(), 1e-5) << ring.size() << " corners, turn " << turn;
            if (turn == 0) first = trianglesOf(mesh);
            EXPECT_EQ(trianglesOf(mesh), first) << ring.size() << " corners, turn " << turn;
            std::reverse(ring.begin(), ring.end());
            std::rotate(ring.begin(), ring.begin() + std::ptrdiff_t(turn + 1), ring.end());
        }
    }
}

// A strip of corners that fold back on themselves has no triangles within; it is read all the same.
TEST_F(PolygonTest, PolygonsThatCrossThemselvesAreRead)
{
    const Mesh mesh = cut({{0, 0, 0}, {1, 1, 0}, {1, 0, 0}, {0, 1, 0}, {2, 0.5, 0}}, "obj");
    EXPECT_EQ(mesh.triangles.size(), 3u);
    EXPECT_EQ(cut({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}}, "off").triangles.size(), 2u);
}

/// The cells of a volume mesh, each with its six faces, which begin anywhere.
std::string hexahedra(int n, Random& random)
{
    std::string text;
    for (int z = 0; z <= n; ++z)
        for (int y = 0; y <= n; ++y)
            for (int x = 0; x <= n; ++x) text += fmt::format("v {} {} {}\n", x, y, z);
    const auto vertex = [&](int x, int y, int z) { return 1 + x + (n + 1) * (y + (n + 1) * z); };
    constexpr int kFaces[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                  {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
    for (int cell = 0; cell < n * n * n; ++cell)
        for (const auto& face : kFaces) {
            const int begin = int(random.below(4));
            text += "f";
            for (int k = 0; k < 4; ++k) {
                const int c = face[(begin + k) % 4];
                text += fmt::format(" {}", vertex(cell % n + (c & 1), cell / n % n + (c >> 1 & 1),
                                                  cell / n / n + (c >> 2)));
            }
            text += "\n";
        }
    return text;
}

TEST_F(PolygonTest, WallsBetweenTheCellsOfAVolumeMeshCancel)
{
    Random random(5);
    const Mesh mesh = readMesh(put("cells.obj", hexahedra(4, random)));
    std::map<std::set<std::uint32_t>, int> times; // by corners, those of a side less the other's
    for (const Mesh::Triangle& t : mesh.triangles) {
        const bool isEven = (t[0] < t[1]) + (t[1] < t[2]) + (t[2] < t[0]) == 2;
        times[{t[0], t[1], t[2]}] += isEven ? 1 : -1;
    }
    std::size_t outer = 0;
    for (const auto& [corners, count] : times) outer += count != 0;
    EXPECT_EQ(outer, std::size_t(2 * 6 * 4 * 4));
}

} // namespace
} // namespace mpuvdb::test
